"""Network namespaces without tools of the host: machines of the test's own, with one network device in user space each.

They need /dev/net/tun, and CAP_SYS_ADMIN or a kernel that gives unprivileged user namespaces: `permitted` finds out.
"""

import contextlib
import ctypes
import fcntl
import os
import signal
import socket
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path

_CLONE_NEWNET, _CLONE_NEWUSER = 0x4000_0000, 0x1000_0000  # linux/sched.h
_TUNSETIFF, _IFF_TUN, _IFF_NO_PI = 0x4004_54CA, 0x0001, 0x1000  # linux/if_tun.h
_SIOCSIFADDR, _SIOCSIFNETMASK, _SIOCSIFMTU = 0x8916, 0x891C, 0x8922  # linux/sockios.h
_SIOCGIFFLAGS, _SIOCSIFFLAGS, _IFF_UP, _IFF_RUNNING = 0x8913, 0x8914, 0x1, 0x40
_SIOCSIFTXQLEN = 0x8943
_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_TUN = Path("/dev/net/tun")
QUEUE = 2000  # packets that wait for a switch which is late
DEVICE = "lab0"
_libc = ctypes.CDLL(None, use_errno=True)


class NotPermitted(Exception):
    """This host gives no namespaces. The message says what is missing."""


def permitted() -> str:
    """Become root of a user namespace where that is what it takes; return how it is done. Call it before any thread.

    Raises NotPermitted.
    """
    if not _TUN.exists():
        raise NotPermitted("there is no /dev/net/tun: load the module tun, or start the container with --device")
    how = "as root"
    if not _may_unshare():
        uid, gid = os.getuid(), os.getgid()
        if _libc.unshare(_CLONE_NEWUSER | _CLONE_NEWNET):  # nobody may come back to a network that is not its own
            raise NotPermitted(
                f"network namespaces need CAP_SYS_ADMIN, or unprivileged user namespaces "
                f"(kernel.unprivileged_userns_clone, seccomp): {os.strerror(ctypes.get_errno())}"
            )
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"0 {uid} 1")
        Path("/proc/self/gid_map").write_text(f"0 {gid} 1")
        _set_up("lo", True)
        how = "in a user namespace"
        if not _may_unshare():
            raise NotPermitted("a user namespace may not have network namespaces here")
    return how


def _may_unshare() -> bool:
    """Try it in a child."""
    child = os.fork()
    if not child:
        os._exit(_libc.unshare(_CLONE_NEWNET) != 0)
    return os.waitpid(child, 0)[1] == 0


class Namespace:
    """A network namespace with a loopback device and, after `connect`, one more. A child process keeps it alive."""

    def __init__(self) -> None:
        read, write = os.pipe()
        self.pid = os.fork()
        if not self.pid:
            os.close(read)
            for number in (signal.SIGINT, signal.SIGTERM):  # they are for who has made it
                signal.signal(number, signal.SIG_IGN)
            _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)  # never without the test
            os._exit(1) if _libc.unshare(_CLONE_NEWNET) else os.write(write, b"1")
            signal.pause()
            os._exit(0)
        os.close(write)
        made = os.read(read, 1)
        os.close(read)
        if not made:
            raise NotPermitted("a network namespace could not be made")
        self._descriptor = os.open(f"/proc/{self.pid}/ns/net", os.O_RDONLY)
        with self.inside():
            _set_up("lo", True)

    def enter(self) -> None:
        """Move this thread there."""
        _enter(self._descriptor)

    @contextlib.contextmanager
    def inside(self) -> Iterator[None]:
        """Be there for a while: sockets that are made meanwhile are of this namespace."""
        home = os.open("/proc/self/ns/net", os.O_RDONLY)
        self.enter()
        try:
            yield
        finally:
            _enter(home)
            os.close(home)

    def connect(self, address: str, mtu: int) -> int:
        """Give it a device with this address (of a /24), and return the descriptor of the device's other end."""
        with self.inside():
            other_end = os.open(_TUN, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
            fcntl.ioctl(other_end, _TUNSETIFF, struct.pack("16sH22x", DEVICE.encode(), _IFF_TUN | _IFF_NO_PI))
            _configure(DEVICE, _SIOCSIFMTU, struct.pack("i", mtu))
            with contextlib.suppress(PermissionError):  # a user namespace keeps the kernel's 500
                _configure(DEVICE, _SIOCSIFTXQLEN, struct.pack("i", QUEUE))
            _configure(DEVICE, _SIOCSIFADDR, _socket_address(address))
            _configure(DEVICE, _SIOCSIFNETMASK, _socket_address("255.255.255.0"))
            _set_up(DEVICE, True)
        return other_end

    def alias(self, number: int, address: str) -> None:
        """Give its loopback device one more address (of a /24), which need not be a loopback address."""
        with self.inside():
            _configure(f"lo:{number}", _SIOCSIFADDR, _socket_address(address))
            _configure(f"lo:{number}", _SIOCSIFNETMASK, _socket_address("255.255.255.0"))

    def start(self, *command: str | Path, **options) -> subprocess.Popen:
        """Start a program there."""
        return subprocess.Popen([str(word) for word in command], preexec_fn=self._begin, **options)

    def _begin(self) -> None:
        _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)  # never without the test
        self.enter()

    def plug(self, in_place: bool, device: str = DEVICE) -> None:
        """Pull the cable out of its device, or put it back."""
        with self.inside():
            _set_up(device, in_place)

    def close(self) -> None:
        """End it."""
        os.close(self._descriptor)
        os.kill(self.pid, signal.SIGKILL)
        os.waitpid(self.pid, 0)


def _enter(descriptor: int) -> None:
    if _libc.setns(descriptor, _CLONE_NEWNET):
        raise OSError(ctypes.get_errno(), "cannot enter a network namespace")


def _configure(device: str, request: int, value: bytes) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        fcntl.ioctl(any_socket, request, struct.pack("16s24s", device.encode(), value))


def _set_up(device: str, up: bool) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        flags = fcntl.ioctl(any_socket, _SIOCGIFFLAGS, struct.pack("16s24x", device.encode()))
        (now,) = struct.unpack_from("H", flags, 16)
        wanted = now | _IFF_UP | _IFF_RUNNING if up else now & ~_IFF_UP
        fcntl.ioctl(any_socket, _SIOCSIFFLAGS, struct.pack("16sH22x", device.encode(), wanted))


def _socket_address(address: str) -> bytes:
    return struct.pack("=HH4s8x", socket.AF_INET, 0, socket.inet_aton(address))
