"""Both arms of one plant behind their links, ticked by a pace: in real time or in lockstep."""

import functools

import numpy as np

from sim_robot.cell import SimulatedCell
from sim_robot.fci import link_faults
from sim_robot.fci.arm_server import ArmServer
from sim_robot.fci.desk_gate import DeskGate
from sim_robot.fci.gripper import GripperPort, vacuum_port
from sim_robot.fci.poller import Poller
from sim_robot.fci.protocol import ROBOT_STATE, Command
from sim_robot.fci.robot_state import MOTION_RECORD, fill_states
from sim_robot.fci.settings import SETTINGS_RECORD, Settings
from sim_robot.fci.tracker_feed import TrackerFeed
from sim_robot.plant_parameters import PlantParameters
from sim_robot.proximity import Proximity

TIDY_AFTER_S = 1.0


class Server:
    """The arm_servers of both arms, and the one way in which the plant goes on."""

    def __init__(self, cell: SimulatedCell, parameters: PlantParameters, addresses: tuple[str, str]) -> None:
        """Listen at both addresses (left, right). Raises OSError when one cannot be taken."""
        self.cell, self.poller, scene = cell, Poller(), cell.scene
        self._wires = np.zeros(2, ROBOT_STATE)
        self._settings = np.zeros(2, SETTINGS_RECORD)
        self._motions = np.zeros(2, MOTION_RECORD)
        self._goals = cell.sensors.kinematics.copy()
        self._collisions = np.zeros(2, dtype=np.int64)
        self._deferred: list[tuple[int, Command, int, tuple]] = []
        self.deferring = False  # True: motions and recoveries wait until the plant is at rest
        self._alone_s, self._tidy = 0.0, True
        self._proximity = Proximity(cell.plant)
        self._feed: TrackerFeed | None = None
        arm_servers = []
        for side, address in enumerate(addresses):
            make_link, make_station = link_faults.kinds(cell.faults, side)
            link = make_link(
                self.poller,
                address,
                on_request=functools.partial(self._request, side),
                on_command=lambda command, side=side: self.arm_servers[side].take(command),
                on_gone=functools.partial(self._gone, side),
            )
            hand, model = (scene.left, scene.right)[side].hand, cell.plant.robots[side]
            settings = Settings(self._settings[side], model, scene.pads[side], parameters.holding.stiffness, hand)
            arm_servers.append(
                make_station(
                    cell,
                    side,
                    link,
                    settings,
                    self._motions[side],
                    self._wires[side : side + 1],
                    self._proximity,
                    self._fill,
                )
            )
        self.arm_servers: tuple[ArmServer, ArmServer] = (arm_servers[0], arm_servers[1])
        hands = tuple(GripperPort(self.poller, *one) for one in zip(addresses, cell.hands, strict=True))
        self.grippers = (*hands, *(vacuum_port(self.poller, address) for address in addresses))
        self._gates: tuple[DeskGate, ...] = ()
        self._proximity.update()
        self._fill()

    def follow_desk(self, flags: np.ndarray) -> None:
        """Do what Desk is told by a person, from now on. flags: sim_robot.desk.flags.FLAGS of both boxes (2,)."""
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
        """Answer the commands to hands that have ended."""
        for gripper in self.grippers:
            gripper.settle()

    def show_grippers(self) -> None:
        """Send the grippers' states where they are due."""
        for gripper in self.grippers:
            gripper.show()

    @property
    def hands_in_use(self) -> bool:
        """True while a client is connected to a hand, or a hand moves."""
        return self.hands_move or any(gripper.in_use for gripper in self.grippers)

    @property
    def hands_move(self) -> bool:
        """True while a hand's fingers are on their way."""
        return any(hand is not None and hand.busy for hand in self.cell.hands)

    def advance(self) -> None:
        """Advance the plant by 1 ms with the commands that have arrived, and judge what it shows."""
        self.cell.next_state()
        if self.cell.faults is not None:
            for side in range(2):
                self._motions[side]["base_shaken"] = self.cell.faults.base_shaken(side)
        self._fill()
        self._proximity.update()
        for side, arm_server in enumerate(self.arm_servers):
            arm_server.judge(int(self._collisions[side]), int(self._proximity.masks[side]))
        self._publish_pose()

    def tidy(self, elapsed_s: float) -> None:
        """Put the object back once no client was connected for TIDY_AFTER_S, as a person does between two trials."""
        if self.hands_in_use or any(arm_server.link.client is not None for arm_server in self.arm_servers):
            self._alone_s, self._tidy = 0.0, False
        elif not self._tidy:
            self._alone_s += elapsed_s
            if self._alone_s >= TIDY_AFTER_S:
                self._tidy, self._alone_s = self.cell.plant.put_object_back(), 0.0

    def feed_tracker(self, feed: TrackerFeed) -> None:
        """Publish what the motion capture sees, from now on."""
        self._feed = feed
        self._publish_pose()

    def _publish_pose(self) -> None:
        """Send a new pose before the states of the same ms go out, stamped as they will be."""
        if self._feed is not None:
            self._feed.publish(self._next_stamp_ns(), 1_000_000 * self.cell.plant.ticks)

    def repeat_pose(self) -> None:
        """Send the last pose again, while the plant stands still and a program may begin to listen."""
        if self._feed is not None:
            self._feed.repeat(self._next_stamp_ns())

    def _next_stamp_ns(self) -> int:
        """The time that the next states will carry: of the arms that move, else of both, the one that is ahead."""
        shown = [arm_server for arm_server in self.arm_servers if arm_server.moving] or self.arm_servers
        return (max(arm_server.message_id for arm_server in shown) + 1) * 1_000_000

    def close(self) -> None:
        """Close every socket."""
        for arm_server in self.arm_servers:
            arm_server.link.close()
        for gripper in self.grippers:
            gripper.close()
        if self._feed is not None:
            self._feed.close()
        self.poller.close()
