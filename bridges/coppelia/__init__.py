"""CoppeliaSim's ZeroMQ remote API: a server for its scripts, and a plant that drives a running CoppeliaSim.

`python -m wayfield.bridges.coppelia` serves a scene; `gymnasium.make(id, dynamics="coppelia")` drives a simulator. Both
need the extra `coppelia`; `import wayfield` imports nothing of this package. Modules:

- server: `codec` (bytes to requests), `server` (sockets, clients, stepping), `signatures` (checks of arguments),
  `calls` and `calls_*` (the functions of `sim`);
- scene: `world` (robot, sonars, time), `sandbox` (its task), `scene` (tree of objects), `models`, `scenes`, `drawing`,
  `window`; `sonars`, `frames`, `curves` are pure functions;
- client: `plant`, `standstill`.
"""
