"""The core of CoppeliaSim's legacy remote API for Python (`simx...`), over the ZeroMQ remote API.

`python -m wayfield.bridges.coppelia --legacy FOLDER` copies this file there as sim.py and vrep.py, in place of those
that load CoppeliaSim's library. It needs only `coppeliasim-zmqremoteapi-client`, and speaks to wayfield's server or to
a CoppeliaSim. $WAYFIELD_COPPELIA=host:port, by default port 23000 of the host of `simxStart`, is where it connects:
ports of the legacy API (19997, 19999, ...) mean nothing here.

Every call returns a code first. As in the legacy library, blocking calls wait for the answer; a streaming or oneshot
call that asks for a value has none the first time (`simx_return_novalue_flag`); buffer calls read what was streamed.
The answer is then that of the moment of the call, which is never older than the library's.
"""

import functools
import inspect
import os
import socket
import struct
import sys
import threading
import time

from coppeliasim_zmqremoteapi_client import RemoteAPIClient

simx_return_ok = 0
simx_return_novalue_flag = 1
simx_return_timeout_flag = 2
simx_return_illegal_opmode_flag = 4
simx_return_remote_error_flag = 8
simx_return_split_progress_flag = 16
simx_return_local_error_flag = 32
simx_return_initialize_error_flag = 64

simx_opmode_oneshot = 0x000000
simx_opmode_blocking = simx_opmode_oneshot_wait = 0x010000
simx_opmode_streaming = simx_opmode_continuous = 0x020000
simx_opmode_oneshot_split = 0x030000
simx_opmode_streaming_split = simx_opmode_continuous_split = 0x040000
simx_opmode_discontinue = 0x050000
simx_opmode_buffer = 0x060000
simx_opmode_remove = 0x070000

simx_headeroffset_crc = 0
simx_headeroffset_version = 2
simx_headeroffset_message_id = 3
simx_headeroffset_client_time = 7
simx_headeroffset_server_time = 11
simx_headeroffset_scene_id = 15
simx_headeroffset_server_state = 17

# The constants of simConst.py that calls of the remote API take or return: sim_KIND_NAME; a number is the next one's
# value, from which on they count up.
_CONSTANTS = """
object: 0 shape_type joint_type graph_type camera_type dummy_type proximitysensor_type 8 path_type visionsensor_type
    volume_type mill_type forcesensor_type light_type mirror_type 200 no_subtype
appobj: 109 object_type collision_type distance_type simulation_type ik_type constraintsolver_type collection_type
    ui_type script_type pathplanning_type 120 texture_type
joint: 10 revolute_subtype prismatic_subtype spherical_subtype
shape: 20 simpleshape_subtype multishape_subtype
proximitysensor: 30 pyramid_subtype cylinder_subtype disc_subtype cone_subtype ray_subtype
objectspecialproperty: 1 collidable measurable 16 detectable_ultrasonic 32 detectable_infrared 64 detectable_laser 128
    detectable_inductive 256 detectable_capacitive 512 renderable 1024 cuttable 2048 pathplanning_ignored 496
    detectable_all
modelproperty: 1 not_collidable not_measurable 4 not_renderable 8 not_detectable 16 not_cuttable 32 not_dynamic 64
    not_respondable 128 not_reset 256 not_visible 61440 not_model
simulation: 0 stopped 8 paused 16 advancing 16 advancing_firstafterstop advancing_running 19 advancing_lastbeforepause
    advancing_firstafterpause advancing_abouttostop advancing_lastbeforestop
scripttype: 0 mainscript childscript 4 jointctrlcallback contactcallback customizationscript generalcallback
handle: -2 all -3 all_except_explicit -4 self -5 main_script -6 tree -7 chain -8 single -9 default -10 all_except_self
    -11 parent
handleflag: 4194304 assembly 8388608 model
dlgstyle: 0 message input ok ok_cancel yes_no 32 dont_center
dlgret: 0 still_open ok cancel yes no
boolparam: 0 hierarchy_visible console_visible collision_handling_enabled distance_handling_enabled
    ik_handling_enabled gcs_handling_enabled dynamics_handling_enabled joint_motion_handling_enabled
    path_motion_handling_enabled proximity_sensor_handling_enabled vision_sensor_handling_enabled
    mill_handling_enabled browser_visible scene_and_model_load_messages 15 shape_textures_are_visible display_enabled
    infotext_visible statustext_open fog_enabled rml2_available rml4_available mirrors_enabled aux_clip_planes_enabled
    full_model_copy_from_api realtime_simulation 27 force_show_wireless_emission force_show_wireless_reception
    video_recording_triggered 32 threaded_rendering_enabled fullscreen headless hierarchy_toolbarbutton_enabled
    browser_toolbarbutton_enabled objectshift_toolbarbutton_enabled objectrotate_toolbarbutton_enabled
    force_calcstruct_all_visible force_calcstruct_all exit_request play_toolbarbutton_enabled
    pause_toolbarbutton_enabled stop_toolbarbutton_enabled waiting_for_trigger
intparam: 0 error_report_mode program_version instance_count custom_cmd_start_id compilation_version current_page
    flymode_camera_handle dynamic_step_divider dynamic_engine server_port_start server_port_range visible_layers
    infotext_style settings edit_mode_type server_port_next qt_version event_flags_read event_flags_read_clear
    platform scene_unique_id work_thread_count mouse_x mouse_y core_count work_thread_calc_time_ms idle_fps
    prox_sensor_select_down prox_sensor_select_up stop_request_counter program_revision mouse_buttons
    dynamic_warning_disabled_mask simulation_warning_disabled_mask scene_index motionplanning_seed speedmodifier
floatparam: 0 rand simulation_time_step stereo_distance
stringparam: 0 application_path video_filename app_arg1 app_arg2 app_arg3 app_arg4 app_arg5 app_arg6 app_arg7 app_arg8
    app_arg9 13 scene_path_and_name
arrayparam: 0 gravity fog fog_color background_color1 background_color2 ambient_light random_euler
objintparam: 10 visibility_layer 27 collection_self_collision_indicator 29 child_role parent_role
    manipulation_permissions illumination_handle
objfloatparam: 11 abs_x_velocity abs_y_velocity abs_z_velocity abs_rot_velocity objbbox_min_x objbbox_min_y
    objbbox_min_z objbbox_max_x objbbox_max_y objbbox_max_z modelbbox_min_x modelbbox_min_y modelbbox_min_z
    modelbbox_max_x modelbbox_max_y modelbbox_max_z 28 transparency_offset
visionfloatparam: 1000 near_clipping far_clipping 1004 perspective_angle ortho_size 1014 pov_blur_distance
    pov_aperture
visionintparam: 1002 resolution_x resolution_y 1006 disabled_light_components rendering_attributes entity_to_render
    windowed_size_x windowed_size_y windowed_pos_x windowed_pos_y pov_focal_blur 1016 pov_blur_sampled render_mode
jointintparam: 2000 motor_enabled ctrl_enabled 2030 velocity_lock vortex_dep_handle
jointfloatparam: 2002 pid_p pid_i pid_d intrinsic_x intrinsic_y intrinsic_z intrinsic_qx intrinsic_qy intrinsic_qz
    intrinsic_qw velocity spherical_qx spherical_qy spherical_qz spherical_qw upper_limit kc_k kc_c 2021 ik_weight
    error_x error_y error_z error_a error_b error_g error_pos error_angle 2032 vortex_dep_multiplication
    vortex_dep_offset
shapefloatparam: 3000 init_velocity_x init_velocity_y init_velocity_z 3005 mass texture_x texture_y texture_z
    texture_a texture_b texture_g texture_scaling_x texture_scaling_y 3020 init_velocity_a init_velocity_b
    init_velocity_g 3025 shading_angle edge_angle
shapeintparam: 3003 static respondable 3014 culling wireframe compound convex convex_check respondable_mask 3024
    edge_visibility 3027 edge_borders_hidden
shapestringparam: 3023 color_name
proxintparam: 4000 ray_invisibility
cameraintparam: 9000 disabled_light_components 9003 rendering_attributes pov_focal_blur 9007 pov_blur_samples
camerafloatparam: 9001 perspective_angle ortho_size 9005 pov_blur_distance pov_aperture
dummyintparam: 10000 link_type
jointmode: 0 passive motion ik ikdependent dependent force
"""


def _constants(table):
    constants, kind, value = {}, "", 0
    for word in table.split():
        if word[-1] == ":":
            kind = word[:-1]
        elif word.lstrip("-").isdigit():
            value = int(word)
        else:
            constants[f"sim_{kind}_{word}"] = value
            value += 1
    return constants


globals().update(_constants(_CONSTANTS))
sim_handle_world = -1
sim_appobj_object_type = 109
sim_jointfloatparam_velocity = 2012
sim_floatparam_simulation_time_step = 1
sim_simulation_paused = 8
# names of old
simx_error_noerror, simx_error_novalue_flag, simx_error_timeout_flag, simx_error_illegal_opmode_flag = 0, 1, 2, 4
simx_error_remote_error_flag, simx_error_split_progress_flag, simx_error_local_error_flag = 8, 16, 32
simx_error_initialize_error_flag = 64

_PORT = 23000
_PATIENCE = 30.0  # s, for an answer
_NONE3 = (0.0, 0.0, 0.0)
_REFUSED = {
    "simxGetVisionSensorImage": "images",
    "simxSetVisionSensorImage": "images",
    "simxGetVisionSensorDepthBuffer": "depth images",
    "simxCallScriptFunction": "scripts inside the simulator",
    "simxLoadModel": "models from files",
    "simxLoadUI": "user interfaces",
    "simxCopyPasteObjects": "copies of objects",
    "simxGetCollisionHandle": "collision objects",
    "simxReadCollision": "collision objects",
    "simxGetDistanceHandle": "distance objects",
    "simxReadDistance": "distance objects",
}


def __getattr__(name):
    if name in _REFUSED:
        raise AttributeError(f"{name}: {_REFUSED[name]} are not offered by this stand-in for the legacy remote API")
    raise AttributeError(f"{name} is not offered by this stand-in for the legacy remote API")


class _Link:
    """A connection; after a call that failed in the middle the next one connects anew."""

    def __init__(self, host, port, timeout):
        self.host, self.port, self.timeout = host, port, timeout
        self.lock = threading.RLock()
        self.begun = set()  # what is streamed
        self.synchronous = False
        self.notes = set()
        self.sim = None
        self.connect()

    def connect(self):
        # the client of ZeroMQ waits for ever without a server
        socket.create_connection((self.host, self.port), self.timeout).close()
        self.client = RemoteAPIClient(self.host, self.port)
        self.client.socket.RCVTIMEO = int(1000 * _PATIENCE)
        self.client.socket.LINGER = 0
        self.sim = self.client.require("sim")

    def close(self):
        if self.sim is not None:
            self.client.socket.close()
            self.sim = None

    def ask(self, function):
        """Returns the code and the result of a function of `sim`."""
        with self.lock:
            try:
                if self.sim is None:
                    self.connect()
                return simx_return_ok, function(self.sim)
            except OSError as error:  # no answer; zmq's errors among them
                self.close()
                self.note(error)
                return simx_return_timeout_flag, None
            except Exception as error:
                if type(error).__module__.startswith("zmq"):
                    self.close()
                    self.note(error)
                    return simx_return_timeout_flag, None
                self.note(error)
                return simx_return_remote_error_flag, None
            except BaseException:  # Ctrl-C within a call: its answer may still come
                self.close()
                raise

    def note(self, error):
        """Writes what the simulator said to stderr, once: codes alone do not tell."""
        if str(error) not in self.notes:
            self.notes.add(str(error))
            print(f"remote API: {error}", file=sys.stderr)


_links: dict[int, _Link] = {}
_next = 0


def _answer(clientID, mode, key, ask):
    """Returns the code and the value of a call that asks for one; None without one."""
    link = _links.get(clientID)
    if link is None:
        return simx_return_initialize_error_flag, None
    kind = int(mode) & ~0xFFFF  # below it are milliseconds
    if kind in (simx_opmode_discontinue, simx_opmode_remove):
        link.begun.discard(key)
        return simx_return_ok, None
    if kind == simx_opmode_buffer:
        if key not in link.begun:
            return simx_return_novalue_flag, None
    elif kind != simx_opmode_blocking:
        if kind not in (simx_opmode_oneshot, simx_opmode_streaming, 0x030000, 0x040000):
            return simx_return_illegal_opmode_flag, None
        if key not in link.begun:
            link.begun.add(key)
            return simx_return_novalue_flag, None
    return link.ask(ask)


def _done(clientID, mode, key, act):
    """Returns the code of a call that acts; one that does not wait has no answer the first time."""
    link = _links.get(clientID)
    if link is None:
        return simx_return_initialize_error_flag
    kind = int(mode) & ~0xFFFF
    if kind in (simx_opmode_discontinue, simx_opmode_remove):
        link.begun.discard(key)
        return simx_return_ok
    code, _ = link.ask(act)
    if kind != simx_opmode_blocking and code == simx_return_ok and key not in link.begun:
        link.begun.add(key)
        return simx_return_novalue_flag
    return code


def _one(answer, nothing):
    code, value = answer
    return code, nothing if value is None else value


def _list(answer, count=3):
    code, value = answer
    return code, [0.0] * count if value is None else [float(each) for each in value]


# Connection.


def simxStart(
    connectionAddress,
    connectionPort,
    waitUntilConnected,
    doNotReconnectOnceDisconnected,
    timeOutInMs,
    commThreadCycleInMs,
):
    """Returns the id of a new connection, or -1."""
    global _next
    host, _, port = os.environ.get("WAYFIELD_COPPELIA", f"{connectionAddress}:{_PORT}").rpartition(":")
    try:
        link = _Link(host, int(port), max(abs(timeOutInMs) / 1000.0, 0.1))
    except Exception as error:
        print(f"remote API: no answer from {host}:{port}: {error}", file=sys.stderr)
        return -1
    _links[_next] = link
    _next += 1
    return _next - 1


def simxFinish(clientID):
    """Ends a connection; -1 ends all."""
    for each in list(_links) if clientID == -1 else [clientID]:
        link = _links.pop(each, None)
        if link is not None:
            link.close()


def simxGetConnectionId(clientID):
    """Returns the id of a connection that is up, else -1."""
    link = _links.get(clientID)
    return clientID if link is not None and link.sim is not None else -1


def simxGetPingTime(clientID):
    """Returns the code and the time of a round trip, ms."""
    began = time.monotonic()
    code, _ = _answer(clientID, simx_opmode_blocking, (), lambda sim: sim.getSimulationState())
    return code, int(1000.0 * (time.monotonic() - began))


def simxGetLastCmdTime(clientID):
    """Returns the time of the simulation, ms."""
    return int(1000.0 * _one(_answer(clientID, simx_opmode_blocking, (), lambda sim: sim.getSimulationTime()), 0.0)[1])


def simxGetInMessageInfo(clientID, infoType):
    """Returns the code and a field of the last message; the server's state has bit 0 unless it is stopped."""
    if infoType == simx_headeroffset_server_state:
        code, state = _one(_answer(clientID, simx_opmode_blocking, (), lambda sim: sim.getSimulationState()), 0)
        return code, (1 if state else 0) | (2 if state == sim_simulation_paused else 0)
    if infoType == simx_headeroffset_server_time:
        return simx_return_ok, simxGetLastCmdTime(clientID)
    return simx_return_ok, 0


def simxPauseCommunication(clientID, pause):
    """Returns 0: commands are never held back, and arrive one after the other."""
    return simx_return_ok


# Simulation.


def _start(link):
    def start(sim):
        if link.synchronous and sim.setStepping(True) > 0:
            sim.setStepping(False)
        sim.startSimulation()

    return start


def simxStartSimulation(clientID, operationMode):
    """Returns the code."""
    link = _links.get(clientID)
    return _done(clientID, operationMode, "start", _start(link))


def simxStopSimulation(clientID, operationMode):
    """Returns the code."""
    return _done(clientID, operationMode, "stop", lambda sim: sim.stopSimulation())


def simxPauseSimulation(clientID, operationMode):
    """Returns the code."""
    return _done(clientID, operationMode, "pause", lambda sim: sim.pauseSimulation())


def simxSynchronous(clientID, enable):
    """Returns the code."""
    link = _links.get(clientID)
    if link is None:
        return simx_return_initialize_error_flag

    def switch(sim):
        if sim.setStepping(bool(enable)) > 0 and enable:
            sim.setStepping(False)

    link.synchronous = bool(enable)
    return link.ask(switch)[0]


def simxSynchronousTrigger(clientID):
    """Returns the code, once the step has been made."""
    return _done(clientID, simx_opmode_blocking, (), lambda sim: sim.step())


def simxAddStatusbarMessage(clientID, message, operationMode):
    """Returns the code."""
    return _done(clientID, operationMode, "message", lambda sim: sim.addLog(450, str(message)))


def simxLoadScene(clientID, scenePathAndName, options, operationMode):
    """Returns the code: a server of wayfield's takes names of its scenes, no files."""
    return _done(clientID, operationMode, "scene", lambda sim: sim.loadScene(str(scenePathAndName)))


def simxGetFloatingParameter(clientID, paramIdentifier, operationMode):
    """Returns the code and the time step, s; an error of the server for another parameter."""

    def read(sim):
        if paramIdentifier == sim_floatparam_simulation_time_step:
            return sim.getSimulationTimeStep()
        return sim.getFloatParam(paramIdentifier)

    return _one(_answer(clientID, operationMode, ("float", paramIdentifier), read), 0.0)


def simxGetIntegerParameter(clientID, paramIdentifier, operationMode):
    """Returns the code and a parameter of the program."""
    return _one(
        _answer(clientID, operationMode, ("int", paramIdentifier), lambda s: s.getInt32Param(paramIdentifier)), 0
    )


def simxGetBooleanParameter(clientID, paramIdentifier, operationMode):
    """Returns the code and a parameter of the program."""
    return _one(
        _answer(clientID, operationMode, ("bool", paramIdentifier), lambda s: s.getBoolParam(paramIdentifier)), 0
    )


def simxSetIntegerParameter(clientID, paramIdentifier, paramValue, operationMode):
    """Returns the code."""
    return _done(
        clientID, operationMode, ("int", paramIdentifier), lambda s: s.setInt32Param(paramIdentifier, paramValue)
    )


def simxSetBooleanParameter(clientID, paramIdentifier, paramValue, operationMode):
    """Returns the code."""
    return _done(
        clientID, operationMode, ("bool", paramIdentifier), lambda s: s.setBoolParam(paramIdentifier, bool(paramValue))
    )


# Objects.


def simxGetObjectHandle(clientID, objectName, operationMode):
    """Returns the code and the handle of an object, by its path or its old name."""
    name = objectName.decode() if isinstance(objectName, bytes) else str(objectName)

    def find(sim):
        return sim.getObject(name) if name[:1] in "/.:" else sim.getObjectHandle(name)

    return _one(_answer(clientID, operationMode, ("handle", name), find), 0)


def simxGetObjects(clientID, objectType, operationMode):
    """Returns the code and the handles of all objects of a type."""
    return _one(
        _answer(clientID, operationMode, ("objects", objectType), lambda s: s.getObjectsInTree(-12, objectType)), []
    )


def simxGetObjectGroupData(clientID, objectType, dataType, operationMode):
    """Returns the code, handles, integers, floats and texts: 0 names, 3 positions, 5 orientations, 9 both."""

    def read(sim):
        handles = sim.getObjectsInTree(-12, -2 if objectType == sim_appobj_object_type else objectType)
        floats, texts = [], []
        for handle in handles:
            if dataType == 0:
                texts.append(sim.getObjectAlias(handle))
            if dataType in (3, 9):
                floats += sim.getObjectPosition(handle, -1)
            if dataType in (5, 9):
                floats += sim.getObjectOrientation(handle, -1)
        return handles, [], floats, texts

    if dataType not in (0, 3, 5, 9):
        raise NotImplementedError(f"simxGetObjectGroupData: data type {dataType} is not offered; 0, 3, 5 and 9 are")
    code, result = _answer(clientID, operationMode, ("group", objectType, dataType), read)
    return (code, *(result or ([], [], [], [])))


def simxGetObjectParent(clientID, childObjectHandle, operationMode):
    """Returns the code and a handle."""
    return _one(
        _answer(clientID, operationMode, ("parent", childObjectHandle), lambda s: s.getObjectParent(childObjectHandle)),
        -1,
    )


def simxGetObjectChild(clientID, parentObjectHandle, childIndex, operationMode):
    """Returns the code and a handle, or -1."""
    key = ("child", parentObjectHandle, childIndex)
    return _one(_answer(clientID, operationMode, key, lambda s: s.getObjectChild(parentObjectHandle, childIndex)), -1)


def simxCreateDummy(clientID, size, color, operationMode):
    """Returns the code and the handle of a new dummy."""
    return _one(_answer(clientID, operationMode, "dummy", lambda sim: sim.createDummy(float(size))), 0)


def simxRemoveObject(clientID, objectHandle, operationMode):
    """Returns the code."""
    return _done(clientID, operationMode, "remove", lambda sim: sim.removeObjects([int(objectHandle)]))


def _getter(name, key):
    def get(clientID, objectHandle, relativeToObjectHandle, operationMode):
        ask = (key, objectHandle, relativeToObjectHandle)
        get_it = lambda sim: getattr(sim, name)(int(objectHandle), int(relativeToObjectHandle))  # noqa: E731
        return _list(_answer(clientID, operationMode, ask, get_it), 4 if key == "quaternion" else 3)

    return get


def _setter(name, key):
    def put(clientID, objectHandle, relativeToObjectHandle, values, operationMode):
        numbers = [float(each) for each in values]
        act = lambda sim: getattr(sim, name)(int(objectHandle), numbers, int(relativeToObjectHandle))  # noqa: E731
        return _done(clientID, operationMode, (key, objectHandle), act)

    return put


simxGetObjectPosition = _getter("getObjectPosition", "position")
simxGetObjectOrientation = _getter("getObjectOrientation", "orientation")
simxGetObjectQuaternion = _getter("getObjectQuaternion", "quaternion")
simxSetObjectPosition = _setter("setObjectPosition", "set position")
simxSetObjectOrientation = _setter("setObjectOrientation", "set orientation")
simxSetObjectQuaternion = _setter("setObjectQuaternion", "set quaternion")


def simxGetObjectVelocity(clientID, objectHandle, operationMode):
    """Returns the code, the linear (m/s) and the angular velocity (rad/s)."""
    key = ("velocity", objectHandle)
    code, result = _answer(clientID, operationMode, key, lambda sim: sim.getObjectVelocity(int(objectHandle)))
    return (code, *([list(each) for each in result] if result else ([0.0] * 3, [0.0] * 3)))


# Joints.


def simxGetJointPosition(clientID, jointHandle, operationMode):
    """Returns the code and the angle of a joint, rad."""
    return _one(
        _answer(clientID, operationMode, ("joint", jointHandle), lambda s: s.getJointPosition(int(jointHandle))), 0.0
    )


def simxSetJointTargetVelocity(clientID, jointHandle, targetVelocity, operationMode):
    """Returns the code; the speed is in rad/s."""
    speed = float(targetVelocity)
    return _done(
        clientID, operationMode, ("speed", jointHandle), lambda s: s.setJointTargetVelocity(int(jointHandle), speed)
    )


def simxSetJointForce(clientID, jointHandle, force, operationMode):
    """Returns the code; wayfield's server takes the force without effect."""
    return _done(
        clientID, operationMode, ("force", jointHandle), lambda s: s.setJointTargetForce(int(jointHandle), float(force))
    )


simxSetJointMaxForce = simxSetJointForce


def simxGetObjectFloatParameter(clientID, objectHandle, parameterID, operationMode):
    """Returns the code and a parameter of an object: the speed of a joint (2012), rad/s."""

    def read(sim):
        if parameterID == sim_jointfloatparam_velocity:
            return sim.getJointVelocity(int(objectHandle))
        return sim.getObjectFloatParam(int(objectHandle), parameterID)

    return _one(_answer(clientID, operationMode, ("parameter", objectHandle, parameterID), read), 0.0)


# Sensors.


def simxReadProximitySensor(clientID, sensorHandle, operationMode):
    """Returns the code, whether there is an echo, its point (m, sensor frame), the object's handle and the normal."""
    key = ("proximity", sensorHandle)
    code, result = _answer(clientID, operationMode, key, lambda sim: sim.readProximitySensor(int(sensorHandle)))
    if not result:
        return code, False, list(_NONE3), 0, list(_NONE3)
    hit, _, point, handle, normal = result
    return code, hit > 0, list(point), handle, list(normal)


def simxReadVisionSensor(clientID, sensorHandle, operationMode):
    """Returns the code, whether something was found, and the packets: of a lidar's half, the second has its points."""
    key = ("vision", sensorHandle)
    code, result = _answer(clientID, operationMode, key, lambda sim: sim.readVisionSensor(int(sensorHandle)))
    return code, bool(result and result[0] > 0), [list(each) for each in result[1:]] if result else []


# Signals.


def _signals(kind, nothing, given):
    def get(clientID, signalName, operationMode):
        key = (kind, signalName)
        code, value = _answer(clientID, operationMode, key, lambda sim: getattr(sim, f"get{kind}Signal")(signalName))
        if value is None:
            # the signal is missing: an error of the server, as there
            return (code or simx_return_remote_error_flag), nothing()
        return code, given(value)

    def put(clientID, signalName, signalValue, operationMode):
        value = signalValue if kind != "Float" else float(signalValue)
        value = bytes(value) if isinstance(value, bytearray) else value
        key = ("set", kind, signalName)
        return _done(clientID, operationMode, key, lambda sim: getattr(sim, f"set{kind}Signal")(signalName, value))

    def clear(clientID, signalName, operationMode):
        key = ("clear", kind, signalName)
        return _done(clientID, operationMode, key, lambda sim: getattr(sim, f"clear{kind}Signal")(signalName))

    return get, put, clear


def _bytes(value):
    return bytearray(value.encode("utf-8") if isinstance(value, str) else value)


simxGetIntegerSignal, simxSetIntegerSignal, simxClearIntegerSignal = _signals("Int32", int, int)
simxGetFloatSignal, simxSetFloatSignal, simxClearFloatSignal = _signals("Float", float, float)
simxGetStringSignal, simxSetStringSignal, simxClearStringSignal = _signals("String", bytearray, _bytes)


def simxGetAndClearStringSignal(clientID, signalName, operationMode):
    """Returns the code and the signal, which is gone then."""
    code, value = simxGetStringSignal(clientID, signalName, operationMode)
    if code == simx_return_ok:
        simxClearStringSignal(clientID, signalName, simx_opmode_blocking)
    return code, value


simxReadStringStream = simxGetAndClearStringSignal


def simxPackInts(intList):
    """Returns numbers as bytes."""
    return struct.pack(f"<{len(intList)}i", *intList)


def simxUnpackInts(intsPackedInString):
    """Returns the numbers in bytes."""
    data = bytes(intsPackedInString)
    return list(struct.unpack(f"<{len(data) // 4}i", data[: len(data) // 4 * 4]))


def simxPackFloats(floatList):
    """Returns numbers as bytes."""
    return struct.pack(f"<{len(floatList)}f", *floatList)


def simxUnpackFloats(floatsPackedInString):
    """Returns the numbers in bytes."""
    data = bytes(floatsPackedInString)
    return list(struct.unpack(f"<{len(data) // 4}f", data[: len(data) // 4 * 4]))


# What NumPy hands over.

_LISTS = ("values", "intList", "floatList")


def _plain(value, name):
    """Returns an argument with NumPy's numbers, and arrays of one where one is asked for, as Python's."""
    if name in _LISTS:
        return [_plain(each, "") for each in (value.ravel() if hasattr(value, "dtype") else value)]
    return value.item() if hasattr(value, "dtype") and getattr(value, "size", 1) == 1 else value


def _takes_numpy(function):
    parameters = inspect.signature(function)

    @functools.wraps(function)
    def called(*args, **kwargs):
        given = parameters.bind(*args, **kwargs).arguments
        return function(**{name: _plain(value, name) for name, value in given.items()})

    return called


for _name in [each for each in globals() if each.startswith("simx") and callable(globals()[each])]:
    globals()[_name] = _takes_numpy(globals()[_name])
