"""CoppeliaSim's ZeroMQ remote API: a server that its scripts drive unchanged, and a plant that drives CoppeliaSim.

`python -m wayfield.envs.coppelia` serves; `gymnasium.make(id, dynamics="coppelia")` drives. Needs the extra
`wayfield[coppelia]`; nothing here is imported by `import wayfield`. The modules: `codec` (bytes to requests), `server`
(sockets, clients, stepping), `signatures` (what a function takes) with the `calls_*` (the functions), `world` (the
robot, time), `scene` (the tree of objects), `models` and `scenes` (what stands in it), `sonars`, `frames` and `curves`
(pure functions), `window` (what one sees), `plant` and `standstill` (the other side).
"""
