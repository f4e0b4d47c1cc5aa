"""What CoppeliaSim has and this server has not, each with the reason: a client that asks is told."""

from wayfield.envs.coppelia.signatures import NOT_OFFERED

_CAMERA = "the scene has no cameras; drive by sonars and poses, or take frames from the server's --render window"
_SCRIPT = "nothing that a client sends is run here"
_FILE = "no file is read or written on a client's word; choose a scene with --scene or sim.loadScene"
_PLUGIN = "there are no plugins"
_MESH = "shapes are discs, boxes and walls; make one with sim.createPrimitiveShape"
_PHYSICS = "the plant drives by wheel speeds: forces on shapes do not act"
_FRAME = "there is no window to draw in; see --render human"

_REASONS = {
    _CAMERA: (
        "getVisionSensorImg getVisionSensorCharImage getVisionSensorDepth getVisionSensorDepthBuffer "
        "getVisionSensorRes getVisionSensorResolution handleVisionSensor readVisionSensor checkVisionSensor "
        "checkVisionSensorEx resetVisionSensor setVisionSensorImg setVisionSensorCharImage getVisionSensorImage "
        "setVisionSensorImage createVisionSensor getCameraMatrix cameraFitToView createCamera transformImage"
    ),
    _SCRIPT: (
        "callScriptFunction executeScriptString launchExecutable createScript addScript associateScriptWithObject "
        "initScript getScript getScriptFunctions loadPlugin getScriptHandle getScriptInt32Param setScriptText "
        "setScriptVariable scheduleExecution broadcastMsg"
    ),
    _FILE: (
        "loadModel saveModel saveScene loadImage saveImage importMesh exportMesh importShape exportSdf "
        "readTexture createTexture writeTexture persistentDataRead persistentDataWrite moduleEntry"
    ),
    _PLUGIN: "simIK simOMPL simUI simUI2 simROS simROS2 simVision simMTB simIGL simURDF simSDF simSubprocess",
    _MESH: (
        "createShape createMeshShape createHeightfieldShape getShapeMesh getShapeViz groupShapes ungroupShape "
        "createPointCloud insertPointsIntoPointCloud createOctree insertVoxelsIntoOctree createJoint "
        "createProximitySensor createForceSensor copyPasteObjects scaleObject scaleObjects"
    ),
    _PHYSICS: (
        "addForce addForceAndTorque addForceToShape getShapeMass setShapeMass getShapeInertia setShapeInertia "
        "computeMassAndInertia readForceSensor breakForceSensor getContactInfo getJointDependency setJointDependency "
        "setJointMode setJointInterval setEngineFloatParam getEngineFloatParam setEngineInt32Param "
        "getEngineInt32Param setEngineBoolParam getEngineBoolParam resetDynamicObject moveToPose moveToConfig "
        "checkCollision checkDistance readGraph setGraphStreamValue addGraphStream createCollection addItemToCollection"
    ),
    _FRAME: "displayDialog endDialog setStatusbarText openFile floatingViewAdd textEditorOpen",
}

for reason, names in _REASONS.items():
    for function in names.split():
        NOT_OFFERED[f"sim.{function}"] = reason
