"""Fixed-shape numpy arrays as Pydantic fields, carried on the wire as little-endian bytes.

The dtype and shape live in the schema, never in the message, so a message cannot lie about them;
a decoded array is a read-only view on the received bytes.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

Float64Array = npt.NDArray[np.float64]

UNIT_TOLERANCE = 1e-3
"""Allowed deviation of a quaternion's norm from one before it is refused."""


@dataclass(frozen=True)
class ArraySpec:
    """Pydantic annotation: finite float64 array of a fixed shape, optionally a unit vector.

    Raises (through Pydantic) ``ValueError`` on a wrong size, a non-finite entry, or, for
    ``unit``, a norm further than :data:`UNIT_TOLERANCE` from one.
    """

    shape: tuple[int, ...]
    unit: bool = False

    def validate(self, value: object) -> Float64Array:
        """Return ``value`` (bytes, array or nested sequence) as a checked array."""
        array: Float64Array
        if isinstance(value, bytes):
            expected = 8 * math.prod(self.shape)
            if len(value) != expected:
                raise ValueError(
                    f"expected {expected} bytes (float64{list(self.shape)}), got {len(value)}"
                )
            array = np.frombuffer(value, dtype="<f8").reshape(self.shape)
        else:
            array = np.asarray(value, dtype=np.float64)
            if array.shape != self.shape:
                raise ValueError(f"expected shape {self.shape}, got {array.shape}")
        # Several times faster than .all() on arrays this small.
        if b"\0" in np.isfinite(array).tobytes():
            raise ValueError("expected finite numbers, got NaN or infinity")
        if self.unit:
            norm = math.hypot(*array.tolist())
            if abs(norm - 1.0) > UNIT_TOLERANCE:
                raise ValueError(f"expected a unit quaternion (w, x, y, z), got norm {norm:.6g}")
        return array

    def __get_pydantic_core_schema__(
        self, _source: Any, _handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self.validate,
            serialization=core_schema.plain_serializer_function_ser_schema(_to_bytes),
        )

    def __get_pydantic_json_schema__(
        self, _schema: CoreSchema, _handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        return {
            "type": "string",
            "contentEncoding": "binary",
            "x-dtype": "<f8",
            "x-shape": list(self.shape),
            "x-unit": self.unit,
        }


def _to_bytes(array: Float64Array) -> bytes:
    return array.tobytes()


Vector2 = Annotated[Float64Array, ArraySpec((2,))]
Vector3 = Annotated[Float64Array, ArraySpec((3,))]
Quaternion = Annotated[Float64Array, ArraySpec((4,), unit=True)]
"""Unit quaternion, scalar first (w, x, y, z)."""
JointVector = Annotated[Float64Array, ArraySpec((27,))]
"""One value per joint in :data:`common.robot.JOINT_NAMES` order."""
