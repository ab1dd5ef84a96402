"""Under which addresses a console is reached: what the guard compares Host and Origin with, to the letter."""

from dataclasses import dataclass
from ipaddress import ip_address

from rtstack.live.stack import LOOPBACK

_DEFAULT_PORTS = {"http": 80, "https": 443}  # which browsers leave out


@dataclass(frozen=True, slots=True)
class Address:
    """host: the IP address that the console listens at; https: whether it speaks nothing else."""

    port: int
    host: str = LOOPBACK
    https: bool = False

    @property
    def scheme(self) -> str:
        """http or https."""
        return "https" if self.https else "http"

    @property
    def base(self) -> str:
        """What is printed, and what invitations begin with."""
        return f"{self.scheme}://{self.host}:{self.port}"

    @property
    def hosts(self) -> frozenset[str]:
        """What a request may call this console."""
        names = (self.host, "localhost") if ip_address(self.host).is_loopback else (self.host,)
        bare = names if self.port == _DEFAULT_PORTS[self.scheme] else ()
        return frozenset({f"{name}:{self.port}" for name in names} | set(bare))

    @property
    def origins(self) -> frozenset[str]:
        """Where our own pages come from."""
        return frozenset(f"{self.scheme}://{host}" for host in self.hosts)
