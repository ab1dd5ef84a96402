"""The arms of one plant behind their links, ticked by a pace: in real time or in lockstep."""

import contextlib
import socket
from functools import partial

import numpy as np

from hal.state import RobotMode
from hal.tracker import ObjectTracker
from hal.tracker_link import DATAGRAM
from hal.wire import ROBOT_STATE
from sim_robot.cell import SimulatedCell
from sim_robot.fci import link_faults
from sim_robot.fci.arm_server import ArmServer
from sim_robot.fci.gripper import GripperPort
from sim_robot.fci.poller import Poller
from sim_robot.fci.protocol import VACUUM_PORT, VACUUM_VERSION, Command
from sim_robot.fci.robot_state import MOTION_RECORD, fill_states
from sim_robot.fci.settings import SETTINGS_RECORD, Settings
from sim_robot.plant_parameters import PlantParameters
from sim_robot.proximity import Proximity

TIDY_AFTER_S = 1.0


class DeskGate:
    """Between the FLAGS of a box (sim_robot.desk.process) and its arm. `look` is called each millisecond."""

    def __init__(self, flags: np.void, arm_server: ArmServer) -> None:
        self._flags, self._arm_server = flags, arm_server
        self._locked = False  # by Desk: a scripted fault shows the same mode

    def look(self) -> None:
        """Follow what Desk was told, and tell it what the arm does."""
        flags, server = self._flags, self._arm_server
        mode = server.box.mode
        flags["moving"] = mode == RobotMode.MOVE
        flags["user_stop"] = mode == RobotMode.USER_STOPPED
        if not flags["fci"]:
            server.preempt()
        server.link.listen(bool(flags["fci"]))
        if flags["locked"] and mode in (RobotMode.IDLE, RobotMode.MOVE):
            server.preempt()
            server.lock_brakes()
            self._locked = True
        elif self._locked and not flags["locked"]:
            self._locked = False
            if mode == RobotMode.OTHER:
                server.box.stop()


class TrackerFeed:
    """Sends each new pose of a tracker once, as a datagram (hal.tracker_link), heard or not. Never blocks."""

    def __init__(self, tracker: ObjectTracker, listener: tuple[str, int]) -> None:
        self._tracker, self._behind_ns = tracker, 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.connect(listener)
        self._sent_t_ns = -1
        self._datagram = np.zeros(1, DATAGRAM)

    def publish(self, robot_t_ns: int, plant_t_ns: int) -> None:
        """Send a new pose with the robot's time, before the state of that time. plant_t_ns: the poses' own time now."""
        pose = self._tracker.latest().record
        t_ns = int(pose["t_ns"][0])
        if t_ns == self._sent_t_ns:
            return
        self._sent_t_ns = t_ns
        self._datagram[:] = pose
        self._behind_ns = plant_t_ns - t_ns
        self.repeat(robot_t_ns)

    def repeat(self, robot_t_ns: int) -> None:
        """Send the last pose again, with another time."""
        self._datagram["t_ns"] = robot_t_ns - self._behind_ns
        with contextlib.suppress(OSError):
            self._socket.send(self._datagram.data)

    def close(self) -> None:
        self._socket.close()


class Server:
    """The arm_servers of all arms, and the one way in which the plant goes on."""

    def __init__(self, cell: SimulatedCell, parameters: PlantParameters, addresses: tuple[str, ...]) -> None:
        """Listen at the arms' addresses, in the order of `Scene.sides`. Raises OSError when one cannot be taken."""
        self.cell, self.poller, scene = cell, Poller(), cell.scene
        count = len(scene.arms)
        self._wires = np.zeros(count, ROBOT_STATE)
        self._settings = np.zeros(count, SETTINGS_RECORD)
        self._motions = np.zeros(count, MOTION_RECORD)
        self._goals = cell.sensors.kinematics.copy()
        self._collisions = np.zeros(count, dtype=np.int64)
        self._deferred: list[tuple[int, Command, int, tuple]] = []
        self.deferring = False  # True: motions and recoveries wait until the plant is at rest
        self._alone_s, self._tidy = 0.0, True
        self._proximity = Proximity(cell.plant)
        self._feed: TrackerFeed | None = None
        arm_servers: list[ArmServer] = []
        for side, (address, place) in enumerate(zip(addresses, scene.arms, strict=True)):
            make_link, make_station = link_faults.kinds(cell.faults, side)
            link = make_link(
                self.poller, address, on_request=partial(self._request, side), on_gone=partial(self._gone, side),
                on_command=lambda command, side=side: self.arm_servers[side].take(command),
            )  # fmt: skip
            model, stiffness = cell.plant.robots[side], parameters.holding.stiffness
            settings = Settings(self._settings[side], model, scene.pads[side], stiffness, place.hand)
            wire = self._wires[side : side + 1]
            arm_servers.append(
                make_station(cell, side, link, settings, self._motions[side], wire, self._proximity, self._fill)
            )
        self.arm_servers = tuple(arm_servers)
        hands = tuple(GripperPort(self.poller, *one) for one in zip(addresses, cell.hands, strict=True))
        # no scene has a vacuum gripper: its port says that none is mounted
        vacuum = (GripperPort(self.poller, address, None, VACUUM_PORT, VACUUM_VERSION) for address in addresses)
        self.grippers = (*hands, *vacuum)
        self._gates: tuple[DeskGate, ...] = ()
        self._proximity.update()
        self._fill()

    def follow_desk(self, flags: np.ndarray) -> None:
        """Do what Desk is told by a person, from now on. flags: sim_robot.desk.process.FLAGS of the boxes (n,)."""
        self._gates = tuple(DeskGate(*one) for one in zip(flags, self.arm_servers, strict=True))
        self.look_at_desk()

    def look_at_desk(self) -> None:
        """Follow what Desk was told meanwhile. Called each millisecond, also where the plant stands still."""
        for gate in self._gates:
            gate.look()

    def _request(self, side: int, command: Command, command_id: int, values: tuple) -> None:
        if self.deferring and command in (Command.MOVE, Command.AUTOMATIC_ERROR_RECOVERY):
            self._deferred.append((side, command, command_id, values))
        else:
            self.arm_servers[side].handle(command, command_id, values)

    def _gone(self, side: int) -> None:
        self._deferred = [request for request in self._deferred if request[0] != side]
        self.arm_servers[side].abandon()

    def resume_requests(self) -> None:
        """Handle what had to wait for the plant to come to rest."""
        self.deferring = False
        deferred, self._deferred = self._deferred, []
        for side, command, command_id, values in deferred:
            self.arm_servers[side].handle(command, command_id, values)

    def _fill(self) -> None:
        cell = self.cell
        fill_states(
            cell.states, cell.sensors.kinematics, self._goals, self._settings, self._motions, cell.plant.motors,
            self._wires, self._collisions,
        )  # fmt: skip

    def settle_grippers(self) -> None:
        for gripper in self.grippers:
            gripper.settle()

    def show_grippers(self) -> None:
        for gripper in self.grippers:
            gripper.show()

    @property
    def hands_in_use(self) -> bool:
        return self.hands_move or any(gripper.in_use for gripper in self.grippers)

    @property
    def hands_move(self) -> bool:
        return any(hand is not None and hand.busy for hand in self.cell.hands)

    def advance(self) -> None:
        """Advance the plant by 1 ms with the commands that have arrived, and judge what it shows."""
        self.cell.next_state()
        if self.cell.faults is not None:
            for side, motion in enumerate(self._motions):
                motion["base_shaken"] = self.cell.faults.base_shaken(side)
        self._fill()
        self._proximity.update()
        for side, arm_server in enumerate(self.arm_servers):
            arm_server.judge(int(self._collisions[side]), int(self._proximity.masks[side]))
        self._publish_pose()

    def tidy(self, elapsed_s: float) -> bool:
        """Put the object back TIDY_AFTER_S after the last client has gone. Returns whether it stands elsewhere now."""
        if self.hands_in_use or any(arm_server.link.client is not None for arm_server in self.arm_servers):
            self._alone_s, self._tidy = 0.0, False
        elif not self._tidy:
            self._alone_s += elapsed_s
            if self._alone_s >= TIDY_AFTER_S:
                self._tidy, self._alone_s = self.cell.plant.put_object_back(), 0.0
                return self._tidy
        return False

    def feed_tracker(self, feed: TrackerFeed) -> None:
        self._feed = feed
        self._publish_pose()

    def _publish_pose(self) -> None:
        """Send a new pose before the states of the same ms go out, stamped as they will be."""
        if self._feed is not None:
            self._feed.publish(self._next_stamp_ns(), 1_000_000 * self.cell.plant.ticks)

    def repeat_pose(self) -> None:
        """Send the last pose again, while the plant stands still and a program may begin to listen."""
        if self._feed is not None and not self.cell.plant.away:
            self._feed.repeat(self._next_stamp_ns())

    def _next_stamp_ns(self) -> int:
        """The time that the next states will carry: of the arms that move, else of all, the one that is ahead."""
        shown = [arm_server for arm_server in self.arm_servers if arm_server.moving] or self.arm_servers
        return (max(arm_server.message_id for arm_server in shown) + 1) * 1_000_000

    def close(self) -> None:
        for arm_server in self.arm_servers:
            arm_server.link.close()
        for gripper in self.grippers:
            gripper.close()
        if self._feed is not None:
            self._feed.close()
        self.poller.close()
