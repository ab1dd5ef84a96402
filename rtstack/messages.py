"""What a JSON message may hold: the keys that are asked for, and in a number's place a number.

Pydantic by itself takes true for 1 and "5" for 5. Its strict integer would refuse 5.0, which JSON Schema calls one.
"""

from typing import Any

from pydantic import BeforeValidator, ConfigDict, StrictBool, StrictFloat, ValidationError

__all__ = ["MESSAGE", "NUMBER", "StrictBool", "StrictFloat", "problem"]

MESSAGE = ConfigDict(extra="forbid", allow_inf_nan=False)


def _number(value: Any) -> Any:
    if isinstance(value, bool | str | bytes):
        raise ValueError("Input should be a number")
    return value


# behind an integer's bounds: what stands behind it is not in the description
NUMBER = BeforeValidator(_number)


def problem(error: ValidationError, whole: str = "the message") -> str:
    """Return the first problem in one line that names the key; `whole` where it is none of a key."""
    first = error.errors(include_url=False, include_input=False)[0]
    return f"{'.'.join(str(part) for part in first['loc']) or whole}: {first['msg']}"
