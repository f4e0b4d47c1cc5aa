"""Searches the gains of a rival: optuna's TPE, one seed."""

from collections.abc import Callable, Mapping

Gains = dict[str, float]


def searched(
    ranges: Mapping[str, tuple[float, float]], score: Callable[[Gains], float], sets: int, *first: Mapping[str, float]
) -> list[Gains]:
    """Returns sets of gains, the best first.

    Args:
        ranges: of each gain, from and to.
        score: of a set; less is better.
        sets: to try; `first` are among them.
    """
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=0))
    for gains in first:
        study.enqueue_trial(dict(gains))
    tries = []
    for _ in range(sets):
        trial = study.ask()
        gains = {name: round(trial.suggest_float(name, *ends), 3) for name, ends in ranges.items()}
        worth = score(gains)
        study.tell(trial, worth)
        tries.append((worth, gains))
    return [gains for _, gains in sorted(tries, key=lambda each: each[0])]
