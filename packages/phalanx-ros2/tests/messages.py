"""ROS 2's messages by their .msg files, decoded by pycdr2: nothing here is Phalanx's."""

from dataclasses import dataclass

from pycdr2 import IdlStruct
from pycdr2.types import float32, float64, int32, sequence, uint8, uint32


@dataclass
class Time(IdlStruct):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct):
    stamp: Time
    frame_id: str

    @property
    def t(self) -> float:
        return self.stamp.sec + 1e-9 * self.stamp.nanosec


@dataclass
class Point(IdlStruct):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct):
    position: Point
    orientation: Quaternion


@dataclass
class PoseStamped(IdlStruct):
    header: Header
    pose: Pose


@dataclass
class Colour(IdlStruct):
    r: float32
    g: float32
    b: float32
    a: float32


@dataclass
class CompressedImage(IdlStruct):
    header: Header
    format: str
    data: sequence[uint8]


@dataclass
class TextureCoordinate(IdlStruct):
    u: float32
    v: float32


@dataclass
class MeshFile(IdlStruct):
    filename: str
    data: sequence[uint8]


@dataclass
class Marker(IdlStruct):
    header: Header
    ns: str
    id: int32
    type: int32
    action: int32
    pose: Pose
    scale: Point
    color: Colour
    lifetime: Time
    frame_locked: bool
    points: sequence[Point]
    colors: sequence[Colour]
    texture_resource: str
    texture: CompressedImage
    uv_coordinates: sequence[TextureCoordinate]
    text: str
    mesh_resource: str
    mesh_file: MeshFile
    mesh_use_embedded_materials: bool


@dataclass
class MarkerArray(IdlStruct):
    markers: sequence[Marker]


@dataclass
class KeyValue(IdlStruct):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct):
    level: uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct):
    header: Header
    status: sequence[DiagnosticStatus]


OK, WARN, ERROR, STALE = range(4)
ADD, DELETE = 0, 2
ARROW, CYLINDER, LINE_LIST = 0, 3, 5
