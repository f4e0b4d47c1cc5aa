"""The guard of goal seekers: no faster towards what the scan sees than can be stopped."""

import math

import numpy as np

from wayfield.system.compiled import allocating, any_layout
from wayfield.system.elementary import sin_cos


@any_layout
@allocating
def guard(ranges, yaw_rates, law, twists):
    """Slows the twists (b, t) down; see `GoalFeatures`. The scan goes once around, from the back.

    law: hull (m), braking (m/s^2), reaction (s), for how long (s) differential drives turn on before they stop, and
    the shares of the velocity and of the yaw rate that are driven at all.
    """
    hull, braking, reaction, late, driving, turning = law
    beams = ranges.shape[1]
    cosines = np.empty(beams)
    sines = np.empty(beams)
    for j in range(beams):
        sines[j], cosines[j] = sin_cos(j * (2.0 * math.pi / beams) - math.pi)
    planar = twists.shape[1] == 3
    for i in range(ranges.shape[0]):
        vx = driving * twists[i, 0]
        vy = driving * twists[i, 1] if planar else 0.0
        w = turning * twists[i, twists.shape[1] - 1]
        twists[i, twists.shape[1] - 1] = w
        if abs(yaw_rates[i]) > abs(w):
            w = yaw_rates[i]
        turned = 0.0 if planar else min(max(late * w, -0.5 * math.pi), 0.5 * math.pi)
        sine, cosine = sin_cos(turned)
        for turn in range(3):
            share = 1.0
            for j in range(beams):
                towards = vx * cosines[j] + vy * sines[j]
                if turned != 0.0 and vx > 0.0:
                    after = cosines[j] * cosine + sines[j] * sine
                    between = sines[j] * turned > 0.0 and (cosine * sines[j] - sine * cosines[j]) * turned < 0.0
                    towards = vx if between and cosines[j] > 0.0 else max(towards, vx * after)
                if towards <= 0.0:
                    continue
                room = max(ranges[i, j] - hull, 0.0)
                most = braking * (math.sqrt(reaction * reaction + 2.0 * room / braking) - reaction)
                if towards <= most:
                    continue
                if planar and turn < 2:
                    vx -= (towards - most) * cosines[j]
                    vy -= (towards - most) * sines[j]
                else:
                    share = min(share, most / towards)
            vx *= share
            vy *= share
        twists[i, 0] = vx
        if planar:
            twists[i, 1] = vy
