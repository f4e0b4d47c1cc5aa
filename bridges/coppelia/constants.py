"""The constants of `sim`, with the values of CoppeliaSim 4.9."""

PROGRAM_VERSION, PROGRAM_REVISION = 40900, 6

HANDLE_WORLD, HANDLE_ALL, HANDLE_PARENT, HANDLE_SCENE, HANDLE_APP = -1, -2, -11, -12, -13

STOPPED, PAUSED, ADVANCING = 0, 8, 16
FIRST, RUNNING, LAST_BEFORE_PAUSE, FIRST_AFTER_PAUSE, ABOUT_TO_STOP, LAST_BEFORE_STOP = 16, 17, 19, 20, 21, 22

SHAPE, JOINT, DUMMY, PROXIMITY_SENSOR, VISION_SENSOR = 0, 1, 4, 5, 9

PLANE, DISC, CUBOID, SPHEROID, CYLINDER, CONE = 1, 2, 3, 4, 5, 6

WXYZ_FLAG = 0x1000000
JOINT_BASE_FLAG = 0x400000
HANDLE_MASK = 0xFFFFF
MAX_HANDLE = 1 << 28  # flags included

# Numbers an item of each kind of drawing object takes.
DRAWING_ITEMS = {0: 3, 1: 6, 2: 9, 7: 3, 8: 3, 9: 7, 10: 7, 11: 7, 12: 7}
DRAWING_CYCLIC = 0x1000
DRAWING_KIND = 0x1F  # the bits of the kind

CONSTANTS = {
    "handle_world": HANDLE_WORLD,
    "handle_all": HANDLE_ALL,
    "handle_all_except_explicit": -3,
    "handle_self": -4,
    "handle_tree": -6,
    "handle_chain": -7,
    "handle_single": -8,
    "handle_parent": HANDLE_PARENT,
    "handle_scene": HANDLE_SCENE,
    "handle_app": HANDLE_APP,
    "handle_inverse": -14,
    "handleflag_wxyzquat": WXYZ_FLAG,
    "handleflag_axis": JOINT_BASE_FLAG,
    "handleflag_reljointbaseframe": JOINT_BASE_FLAG,
    "handleflag_addmultiple": WXYZ_FLAG,
    "simulation_stopped": STOPPED,
    "simulation_paused": PAUSED,
    "simulation_advancing": ADVANCING,
    "simulation_advancing_firstafterstop": FIRST,
    "simulation_advancing_running": RUNNING,
    "simulation_advancing_lastbeforepause": LAST_BEFORE_PAUSE,
    "simulation_advancing_firstafterpause": FIRST_AFTER_PAUSE,
    "simulation_advancing_abouttostop": ABOUT_TO_STOP,
    "simulation_advancing_lastbeforestop": LAST_BEFORE_STOP,
    "sceneobject_shape": SHAPE,
    "sceneobject_joint": JOINT,
    "sceneobject_dummy": DUMMY,
    "sceneobject_proximitysensor": PROXIMITY_SENSOR,
    "sceneobject_visionsensor": VISION_SENSOR,
    "sceneobject_forcesensor": 12,
    "joint_revolute": 10,
    "jointmode_kinematic": 0,
    "jointmode_dependent": 4,
    "jointmode_dynamic": 5,
    "jointdynctrl_free": 0,
    "jointdynctrl_force": 1,
    "jointdynctrl_velocity": 4,
    "jointdynctrl_position": 8,
    "primitiveshape_plane": PLANE,
    "primitiveshape_disc": DISC,
    "primitiveshape_cuboid": CUBOID,
    "primitiveshape_spheroid": SPHEROID,
    "primitiveshape_cylinder": CYLINDER,
    "primitiveshape_cone": CONE,
    "drawing_points": 0,
    "drawing_lines": 1,
    "drawing_triangles": 2,
    "drawing_spherepts": 7,
    "drawing_spherepoints": 7,
    "drawing_linestrip": 8,
    "drawing_trianglepts": 9,
    "drawing_quadpts": 10,
    "drawing_discpts": 11,
    "drawing_cubepts": 12,
    "drawing_painttag": 1024,
    "drawing_cyclic": DRAWING_CYCLIC,
    "drawing_overlay": 262144,
    "drawing_local": 8388608,
    "verbosity_none": 100,
    "verbosity_errors": 200,
    "verbosity_warnings": 300,
    "verbosity_loadinfos": 400,
    "verbosity_scripterrors": 420,
    "verbosity_scriptwarnings": 430,
    "verbosity_scriptinfos": 450,
    "verbosity_infos": 500,
    "verbosity_debug": 600,
    "verbosity_undecorated": 61440,
    "boolparam_realtime_simulation": 25,
    "intparam_program_version": 1,
    "intparam_idle_fps": 26,
    "intparam_program_revision": 30,
    "floatparam_simulation_time_step": 1,
}
