"""The list of functions that a client receives for `sim`, and the functions of CoppeliaSim that are not offered."""

from typing import TYPE_CHECKING, Any

from wayfield.bridges.coppelia import calls_data, calls_objects, calls_paths, calls_simulation  # noqa: F401
from wayfield.bridges.coppelia.constants import CONSTANTS
from wayfield.bridges.coppelia.signatures import FUNCTIONS, CallError, Name, offered

if TYPE_CHECKING:
    from wayfield.bridges.coppelia.server import Caller

# Function and reason. They are listed to clients, for an unlisted name is an AttributeError without a reason.
NOT_OFFERED = {
    f"sim.{function}": reason
    for reason, functions in {
        "the scene has no cameras; drive by sonars and poses, or take frames from the server's --render window": """
            getVisionSensorImg getVisionSensorCharImage getVisionSensorDepth getVisionSensorDepthBuffer
            getVisionSensorRes getVisionSensorResolution handleVisionSensor checkVisionSensor
            checkVisionSensorEx resetVisionSensor setVisionSensorImg setVisionSensorCharImage getVisionSensorImage
            setVisionSensorImage createVisionSensor getCameraMatrix cameraFitToView createCamera transformImage""",
        "nothing that a client sends is run here": """
            callScriptFunction executeScriptString launchExecutable createScript addScript associateScriptWithObject
            initScript getScript getScriptFunctions loadPlugin getScriptHandle getScriptInt32Param setScriptText
            setScriptVariable scheduleExecution broadcastMsg""",
        "no file is read or written on a client's word; choose a scene with --scene or sim.loadScene": """
            loadModel saveModel saveScene closeScene loadImage saveImage importMesh exportMesh importShape exportSdf
            readTexture createTexture writeTexture persistentDataRead persistentDataWrite moduleEntry""",
        "there are no plugins": """
            simIK simOMPL simUI simUI2 simROS simROS2 simVision simMTB simIGL simURDF simSDF simSubprocess""",
        "shapes are discs, boxes and walls; make one with sim.createPrimitiveShape": """
            createShape createMeshShape createHeightfieldShape getShapeMesh getShapeViz getShapeBB groupShapes
            ungroupShape createPointCloud insertPointsIntoPointCloud createOctree insertVoxelsIntoOctree createJoint
            createProximitySensor createForceSensor copyPasteObjects scaleObject scaleObjects""",
        "the plant drives by wheel speeds, sim.setJointTargetVelocity: forces, angles and modes do not act": """
            addForce addForceAndTorque addForceToShape getShapeMass setShapeMass getShapeInertia setShapeInertia
            computeMassAndInertia readForceSensor breakForceSensor getContactInfo getJointDependency
            setJointDependency setJointMode getJointMode getJointType setJointInterval getJointInterval
            setJointPosition setJointTargetPosition getJointTargetForce getJointMaxForce getJointForce
            setEngineFloatParam getEngineFloatParam
            setEngineInt32Param getEngineInt32Param setEngineBoolParam getEngineBoolParam resetDynamicObject
            moveToPose moveToConfig checkCollision checkDistance readGraph setGraphStreamValue addGraphStream
            createCollection addItemToCollection""",
        "parameters of objects are fixed": "getObjectInt32Param getObjectFloatParam",
        "compute it in the script, with NumPy or scipy.spatial.transform": """
            buildMatrix buildPose poseToMatrix matrixToPose multiplyPoses getPoseInverse interpolatePoses
            interpolateMatrices getEulerAnglesFromMatrix alphaBetaGammaToYawPitchRoll yawPitchRollToAlphaBetaGamma
            invertMatrix resamplePath getConfigDistance""",
        "use the data blocks and properties of objects, such as sim.setTableProperty": """
            readCustomTableData writeCustomTableData""",
        "the time step is that of --dt, sim.getSimulationTimeStep": "getFloatParam setFloatParam",
        "use sim.getBoolParam(sim.boolparam_realtime_simulation)": "getRealTimeSimulation",
        "a sonar reads nothing before the first pass": "resetProximitySensor",
        "there is no window to draw in; see --render human": """
            displayDialog endDialog setStatusbarText openFile floatingViewAdd textEditorOpen getStringParam""",
    }.items()
    for function in functions.split()
}


@offered(module=Name)
def require(caller: "Caller", module: str) -> None:
    """Raises CallError for every module but `sim`."""
    if module not in ("sim", "zmqRemoteApi"):
        reason = NOT_OFFERED.get(f"sim.{module}")
        raise CallError(f"module '{module}' not found", reason or "wayfield's server has sim")


@offered(module=Name)
def info(caller: "Caller", module: str) -> dict[str, Any]:
    """Returns every function and constant of a module, flat."""
    require(caller, module)
    listed: dict[str, Any] = {}
    for each in (*FUNCTIONS, *NOT_OFFERED):
        where, _, function = each.partition(".")
        if where == module:
            listed[function] = {"func": {}}
    if module == "sim":
        listed |= {constant: {"const": value} for constant, value in CONSTANTS.items()}
    return listed


for each in (require, info):
    FUNCTIONS[f"zmqRemoteApi.{each.__name__}"] = FUNCTIONS.pop(f"sim.{each.__name__}")
