"""Setting properties of Blender's data so that nothing is changed silently on the way."""

import numpy as np

from protocol import InputError


def set_value(owner, name, value, place):
    """Set `owner.name` and make sure that Blender kept the value (numbers: as f32)."""
    try:
        setattr(owner, name, value)
        kept = getattr(owner, name)
    except (AttributeError, TypeError, ValueError) as error:
        raise InputError(
            place, f"{value!r} ({error})", "a property and a value that Blender knows", "mend the value"
        ) from None
    if isinstance(value, (float, list)):
        same = np.array_equal(np.asarray(value, np.float32), np.asarray(kept, np.float32))
    else:
        same = kept == value
    if not same:
        raise InputError(
            place,
            repr(value),
            "a value within the limits of the property",
            f"choose one within them: Blender would keep {kept if np.isscalar(kept) else list(kept)}",
        )


def set_fields(owner, fields, entry):
    """Set each attribute of `fields` {key: attribute} to the value of its key in `entry`, a Located."""
    for key, attribute in fields.items():
        set_value(owner, attribute, entry[key], f"{entry.place}.{key}")
