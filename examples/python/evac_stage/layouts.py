"""evac's layouts as ctypes structures, and its services, from services.json (which `evac services` prints).

A field that does not lie where the Rust compiler put it is refused here, and another version of evac by the layout's
hash, which every service carries as an attribute.
"""

import ctypes
import json
import re
from pathlib import Path

CATALOGUE = json.loads((Path(__file__).parent / "services.json").read_text())
SERVICES = CATALOGUE["services"]

_SCALARS = {
    "u8": ctypes.c_uint8, "i8": ctypes.c_int8, "u16": ctypes.c_uint16, "u32": ctypes.c_uint32, "i32": ctypes.c_int32,
    "u64": ctypes.c_uint64, "i64": ctypes.c_int64, "f32": ctypes.c_float, "f64": ctypes.c_double,
}
_NAME_OF_TYPE = {layout["type"]: name for name, layout in CATALOGUE["layouts"].items()}
_structures = {}


def structure(name):
    """The structure of a layout by its versioned name, for example `evac.Point.v1`."""
    if name not in _structures:
        layout = CATALOGUE["layouts"][name]
        fields = [(field, _ctype(ty)) for field, ty, _ in layout["fields"]]
        made = type(layout["type"], (ctypes.Structure,), {"_fields_": fields, "type_name": staticmethod(lambda: name)})
        offsets = [getattr(made, field).offset for field, _, _ in layout["fields"]]
        if ctypes.sizeof(made) != layout["size"] or offsets != [offset for _, _, offset in layout["fields"]]:
            raise ImportError(f"{name} is laid out in another way on this machine; services.json does not fit it")
        _structures[name] = made
    return _structures[name]


def _ctype(ty):
    array = re.fullmatch(r"\[(\w+); (\d+)\]", ty)
    if array:
        return _ctype(array[1]) * int(array[2])
    return _SCALARS[ty] if ty in _SCALARS else structure(_NAME_OF_TYPE[ty])


def text(value, array):
    """A zero-padded text field with `value` in it, cut at a character's border."""
    size = ctypes.sizeof(array)
    return array(*value.encode()[:size].decode(errors="ignore").encode())


def text_of(array):
    """What a zero-padded text field says."""
    return bytes(array).split(b"\0", 1)[0].decode(errors="replace")


def by_type(ty):
    """The newest structure of a Rust type's name, for example `Health`."""
    return structure(_NAME_OF_TYPE[ty])
