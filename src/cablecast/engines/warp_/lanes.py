"""Lanes: how one source of the physics runs as SIMD on a CPU and as one world per thread on CUDA.

A lane value holds one number for each of a few worlds side by side. On a CPU sixteen
single-precision worlds fill a 512-bit register or two of 256 bits, and every operation below
becomes one or two vector instructions; on CUDA the lane count is 1, since a GPU thread is itself a
lane. A `vec3` has a row of lanes for each of x, y and z. All functions are built per precision and
lane count, so that nothing is converted at run time.
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

LANE_COUNT_CPU = {"single": 16, "double": 8}
LANE_COUNT_CUDA = 1


@functools.cache
def lane_types(precision: str, lane_count: int) -> SimpleNamespace:
    """Build the types for a precision and a lane count.

    Args:
        precision: "single" or "double".
        lane_count: Worlds per thread.

    Returns:
        `real` (scalar), `lane` (one value per world), `vec3` (x, y, z per world), `precision`
        and `lane_count`.
    """
    real = wp.float32 if precision == "single" else wp.float64
    return SimpleNamespace(
        precision=precision,
        lane_count=lane_count,
        real=real,
        lane=wp.types.vector(length=lane_count, dtype=real),
        vec3=wp.types.matrix(shape=(3, lane_count), dtype=real),
    )


@functools.cache
def lane_functions(precision: str, lane_count: int) -> SimpleNamespace:
    """Build the Warp functions of arithmetic on lanes."""
    types = lane_types(precision, lane_count)
    real, lane, vec3 = types.real, types.lane, types.vec3
    # Components are read and written one by one below; the compiler turns the unrolled loops into
    # vector instructions.
    count = wp.constant(lane_count)

    @wp.func
    def fill(value: real):
        """Return a lane with the same value for every world."""
        return lane(value)

    @wp.func
    def dot(a: vec3, b: vec3):
        """Return the inner product of two vectors in each lane."""
        product = wp.cw_mul(a, b)
        return product[0] + product[1] + product[2]

    @wp.func
    def cross(a: vec3, b: vec3):
        """Return the vector product in each lane, in the product of the units."""
        return wp.matrix_from_rows(
            wp.cw_mul(a[1], b[2]) - wp.cw_mul(a[2], b[1]),
            wp.cw_mul(a[2], b[0]) - wp.cw_mul(a[0], b[2]),
            wp.cw_mul(a[0], b[1]) - wp.cw_mul(a[1], b[0]),
        )

    @wp.func
    def scale(s: lane, a: vec3):
        """Return a vector times a number in each lane."""
        return wp.matrix_from_rows(wp.cw_mul(s, a[0]), wp.cw_mul(s, a[1]), wp.cw_mul(s, a[2]))

    @wp.func
    def absolute(a: lane):
        """Return the absolute value in each lane."""
        result = lane()
        for k in range(count):
            result[k] = wp.abs(a[k])
        return result

    @wp.func
    def smaller(a: lane, b: lane):
        """Return the smaller number in each lane, b where either is not a number."""
        result = lane()
        for k in range(count):
            result[k] = wp.where(a[k] < b[k], a[k], b[k])
        return result

    @wp.func
    def larger(a: lane, b: lane):
        """Return the larger number in each lane, b where either is not a number."""
        result = lane()
        for k in range(count):
            result[k] = wp.where(a[k] > b[k], a[k], b[k])
        return result

    @wp.func
    def is_positive(a: lane):
        """Return 1 in each lane where a number is positive, else 0."""
        return smaller(larger(a * real(1.0e9), lane()), lane(real(1.0)))

    @wp.func
    def reciprocal(a: lane):
        """Return 1 / a in each lane, 0 where a is 0, such as the mass of a node."""
        return wp.cw_div(a, wp.cw_mul(a, a) + lane(real(1.0e-20)))

    @wp.func
    def root(a: lane):
        """Return the square root in each lane."""
        result = lane()
        for k in range(count):
            result[k] = wp.sqrt(a[k])
        return result

    @wp.func
    def sin_cos(angle: lane):
        """Return sine and cosine in each lane, for angles within two turns [rad].

        It is a Taylor series at an eighth of the angle, doubled three times: exact to rounding, and
        made of multiplications only.
        """
        a = angle * real(0.125)
        q = wp.cw_mul(a, a)
        one = lane(real(1.0))
        s = one - q * real(1.0 / 110.0)
        s = one - wp.cw_mul(q * real(1.0 / 72.0), s)
        s = one - wp.cw_mul(q * real(1.0 / 42.0), s)
        s = one - wp.cw_mul(q * real(1.0 / 20.0), s)
        s = one - wp.cw_mul(q * real(1.0 / 6.0), s)
        s = wp.cw_mul(a, s)
        # 1 - cos keeps its digits through the doublings where cos itself would lose them.
        h = one - q * real(1.0 / 132.0)
        h = one - wp.cw_mul(q * real(1.0 / 90.0), h)
        h = one - wp.cw_mul(q * real(1.0 / 56.0), h)
        h = one - wp.cw_mul(q * real(1.0 / 30.0), h)
        h = one - wp.cw_mul(q * real(1.0 / 12.0), h)
        h = wp.cw_mul(q * real(0.5), h)
        for _ in range(3):
            two_s = s + s
            h_new = wp.cw_mul(two_s, s)
            s = wp.cw_mul(two_s, one - h)
            h = h_new
        return wp.matrix_from_rows(s, one - h)

    return SimpleNamespace(
        **vars(types),
        fill=fill,
        dot=dot,
        cross=cross,
        scale=scale,
        absolute=absolute,
        is_positive=is_positive,
        reciprocal=reciprocal,
        smaller=smaller,
        larger=larger,
        root=root,
        sin_cos=sin_cos,
        mul=wp.cw_mul,
        div=wp.cw_div,
    )
