"""A ROS 2 robot of pycdr2 and Zenoh alone, as a process: nothing here is Phalanx's.

pip install ./packages/phalanx-ros2 pycdr2
python examples/ros2_robots/robot.py ROUTER NAME X Y TURN [--loss P] [--delay S] [--silent-after N]

It integrates the newest Twist, and publishes Odometry at its own rate, until its input closes.
Its last line is a table in JSON: numbers of messages, and when it last got a velocity.
"""

import argparse
import json
import math
import random
import sys
import threading
import time
from dataclasses import dataclass

import zenoh
from pycdr2 import IdlStruct
from pycdr2.types import array, float64, int32, uint32

ODOMETRY = "nav_msgs::msg::dds_::Odometry_"
TWIST = "geometry_msgs::msg::dds_::Twist_"
Covariance = array[float64, 36]  # type: ignore[valid-type]
HASHES = {
    ODOMETRY: "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    TWIST: "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
}
"""Of ROS 2 Jazzy's definitions."""


@dataclass
class Time(IdlStruct):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct):
    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Quaternion(IdlStruct):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct):
    position: Vector3
    orientation: Quaternion


@dataclass
class PoseWithCovariance(IdlStruct):
    pose: Pose
    covariance: Covariance


@dataclass
class Twist(IdlStruct):
    linear: Vector3
    angular: Vector3


@dataclass
class TwistWithCovariance(IdlStruct):
    twist: Twist
    covariance: Covariance


@dataclass
class Odometry(IdlStruct):
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("router")
    parser.add_argument("name")
    for field in ("x", "y", "turn"):
        parser.add_argument(field, type=float)
    parser.add_argument("--loss", type=float, default=0.0, help="of odometry and of velocities")
    parser.add_argument("--delay", type=float, default=0.0, help="of odometry [s]")
    parser.add_argument("--rate", type=float, default=40.0, help="of odometry [Hz]")
    parser.add_argument(
        "--silent-after", type=float, default=math.inf, help="no odometry after so many velocities"
    )
    options = parser.parse_args()
    Robot(options).run()


class Robot:
    def __init__(self, options: argparse.Namespace) -> None:
        self.options, self.random = options, random.Random(options.name)
        self.x, self.y, self.turn = options.x, options.y, options.turn
        self.v = self.w = 0.0
        self.accepted = self.zeros = 0
        self.over = threading.Event()
        config = {"mode": "client", "connect": {"endpoints": [options.router], "timeout_ms": -1}}
        self.session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
        self.moved_since = time.monotonic()
        self.pending: list[tuple[float, bytes]] = []

    def key(self, topic: str, kind: str) -> str:
        return f"0/agent_{self.options.name}/{topic}/{kind}/{HASHES[kind]}"

    def take(self, sample: zenoh.Sample) -> None:
        if self.random.random() < self.options.loss:
            return
        twist = Twist.deserialize(sample.payload.to_bytes())
        self.v, self.w = twist.linear.x, twist.angular.z
        self.accepted += 1
        self.zeros += not (self.v or self.w)

    def run(self) -> None:
        out = self.session.declare_publisher(self.key("odom", ODOMETRY))
        self.session.declare_subscriber(self.key("cmd_vel", TWIST), self.take)
        threading.Thread(target=self.read, daemon=True).start()
        print("ready", flush=True)
        while not self.over.wait(1.0 / self.options.rate):
            now = time.monotonic()
            self.move(now)
            if self.random.random() >= self.options.loss:
                self.pending.append((now + self.options.delay, self.odometry()))
            while self.pending and self.pending[0][0] <= now:
                payload = self.pending.pop(0)[1]
                if self.accepted < self.options.silent_after:
                    out.put(payload)
        self.session.close()
        print(json.dumps({"taken": self.accepted, "zeros": self.zeros, "v": self.v, "w": self.w}))

    def read(self) -> None:
        sys.stdin.read()
        self.over.set()

    def move(self, now: float) -> None:
        dt, self.moved_since = now - self.moved_since, now
        middle = self.turn + self.w * dt / 2
        self.x += self.v * dt * math.cos(middle)
        self.y += self.v * dt * math.sin(middle)
        self.turn += self.w * dt

    def odometry(self) -> bytes:
        seconds, rest = divmod(time.time_ns(), 10**9)
        half, none = math.remainder(self.turn, math.tau) / 2, [0.0] * 36
        turned = Quaternion(0.0, 0.0, math.sin(half), math.cos(half))
        pose = Pose(Vector3(self.x, self.y, 0.0), turned)
        twist = Twist(Vector3(self.v), Vector3(z=self.w))
        header = Header(Time(seconds, rest), "odom")
        message = Odometry(
            header, "base_link", PoseWithCovariance(pose, none), TwistWithCovariance(twist, none)
        )
        return bytes(message.serialize())


if __name__ == "__main__":
    main()
