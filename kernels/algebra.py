"""Vector algebra for one particle or eight SIMD lanes, by the same names.

Powers by logarithms and exponentials that the compiler knows. A GPU has instructions for both, and on a CPU they are
arithmetic that vectorizes over eight lanes, which a call of the library's `pow` is not.

Eight side by side, one instruction of a CPU serves all of them: each has a *lane*. A lane is a world or a particle, see
`kernels.schedules.lanes`. Loops over the lanes have constant bounds: Warp unrolls them, and the compiler makes vector
instructions of them, also where the body calls a law for one particle. It is less sure of that where components mix;
that algebra is native, a row of eight at a time.
"""

import warp as wp

from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes3, Lanes5, of_lane


@wp.func_native(
    """
    #pragma clang fp contract(fast)
#if defined(__CUDA_ARCH__)
    return exp2f(exponent * log2f(base));
#else
    // base = 2^whole m with m from root(1/2) to root(2), and log2(m) by its series, fitted to 7e-10 of it
    const int bits = __builtin_bit_cast(int, base);
    const int places = (bits - 0x3f3504f3) & ~0x7fffff;
    const float whole = (float)(places >> 23);
    const float m = __builtin_bit_cast(float, bits - places);
    const float s = (m - 1.0f) / (m + 1.0f);
    const float z = s * s;
    const float logarithm = s * (2.88539008f + z * (0.96179885f + z * (0.5767144f + z * 0.43173564f)));
    // 2^(exponent (whole + logarithm)) = 2^nearest 2^rest, the latter by its series, fitted to 2e-9
    const float sum = exponent * (whole + logarithm);
    const float bounded = sum < -126.0f ? -126.0f : (sum > 127.0f ? 127.0f : sum);
    const float nearest = (bounded + 12582912.0f) - 12582912.0f;
    const float rest = bounded - nearest;
    const float slope = 0.693147203f + rest * (0.240226479f + rest * (0.0555033216f
        + rest * (0.0096184386f + rest * (0.00133990034f + rest * 0.00015353258f))));
    return (1.0f + rest * slope) * __builtin_bit_cast(float, ((int)nearest + 127) << 23);
#endif
    """,
    adj_snippet="""
    const float power = wp::pow(base, exponent);
    adj_base += adj_ret * exponent * power / base;
    adj_exponent += adj_ret * power * wp::log(base);
    """,
)
def power(base: float, exponent: float) -> float:
    """Return base^exponent for a positive base, with a relative error of 3e-7 plus 6e-8 for each doubling.

    The compiler takes the logarithm once where several powers of a base stand side by side.
    """
    return wp.pow(base, exponent)


NOT_QUITE_ZERO = wp.constant(1.0e-20)
"""Small addend to a squared length, so that its root can be a divisor [m^2]"""


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    return rsqrtf(x);
#else
    return 1.0f / sqrtf(x);
#endif
    """,
    adj_snippet="adj_x -= 0.5f * adj_ret / (x * sqrtf(x));",
)
def inverse_root(x: float) -> float:
    """Return 1 / sqrt(x); one instruction of a GPU, where the division of a root takes two even with fast math."""
    ...


# ---- products
@wp.func
def times(a: float, b: float):
    """Return a b."""
    return a * b


@wp.func
def times(a: Lanes, b: Lanes):  # noqa: F811 - an overload
    """Return a b in each lane."""
    return wp.cw_mul(a, b)


@wp.func
def times(a: float, b: Lanes):  # noqa: F811 - an overload
    """Return a b in each lane."""
    return a * b


@wp.func
def cross_product(a: wp.vec3, b: wp.vec3):
    """Return a x b."""
    return wp.cross(a, b)


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight* p = reinterpret_cast<const eight*>(&a.data[0][0]);
    const eight* q = reinterpret_cast<const eight*>(&b.data[0][0]);
    wp::mat_t<3, 8, wp::float32> result;
    eight* r = reinterpret_cast<eight*>(&result.data[0][0]);
    r[0] = p[1] * q[2] - p[2] * q[1];
    r[1] = p[2] * q[0] - p[0] * q[2];
    r[2] = p[0] * q[1] - p[1] * q[0];
    return result;
    """,
    adj_snippet="""
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight* p = reinterpret_cast<const eight*>(&a.data[0][0]);
    const eight* q = reinterpret_cast<const eight*>(&b.data[0][0]);
    const eight* r = reinterpret_cast<const eight*>(&adj_ret.data[0][0]);
    eight* u = reinterpret_cast<eight*>(&adj_a.data[0][0]);
    eight* v = reinterpret_cast<eight*>(&adj_b.data[0][0]);
    u[0] += q[1] * r[2] - q[2] * r[1];
    u[1] += q[2] * r[0] - q[0] * r[2];
    u[2] += q[0] * r[1] - q[1] * r[0];
    v[0] += r[1] * p[2] - r[2] * p[1];
    v[1] += r[2] * p[0] - r[0] * p[2];
    v[2] += r[0] * p[1] - r[1] * p[0];
    """,
)
def cross_product(a: Lanes3, b: Lanes3) -> Lanes3:  # noqa: F811 - an overload
    """Return a x b in each lane."""
    ...


@wp.func
def dot_product(a: wp.vec3, b: wp.vec3):
    """Return a . b."""
    return wp.dot(a, b)


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight* p = reinterpret_cast<const eight*>(&a.data[0][0]);
    const eight* q = reinterpret_cast<const eight*>(&b.data[0][0]);
    wp::vec_t<8, wp::float32> result;
    *reinterpret_cast<eight*>(&result.c[0]) = p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    return result;
    """,
    adj_snippet="""
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight* p = reinterpret_cast<const eight*>(&a.data[0][0]);
    const eight* q = reinterpret_cast<const eight*>(&b.data[0][0]);
    const eight r = *reinterpret_cast<const eight*>(&adj_ret.c[0]);
    eight* u = reinterpret_cast<eight*>(&adj_a.data[0][0]);
    eight* v = reinterpret_cast<eight*>(&adj_b.data[0][0]);
    for (int axis = 0; axis < 3; ++axis) {
        u[axis] += r * q[axis];
        v[axis] += r * p[axis];
    }
    """,
)
def dot_product(a: Lanes3, b: Lanes3) -> Lanes:  # noqa: F811 - an overload
    """Return a . b in each lane."""
    ...


@wp.func
def reach_along(vector: wp.vec3, direction: wp.vec3):
    """Component of a vector along a direction."""
    return wp.dot(vector, direction)


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight* p = reinterpret_cast<const eight*>(&vector.data[0][0]);
    wp::vec_t<8, wp::float32> result;
    *reinterpret_cast<eight*>(&result.c[0]) = direction.c[0] * p[0] + direction.c[1] * p[1] + direction.c[2] * p[2];
    return result;
    """,
    adj_snippet="""
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight* p = reinterpret_cast<const eight*>(&vector.data[0][0]);
    const eight r = *reinterpret_cast<const eight*>(&adj_ret.c[0]);
    eight* u = reinterpret_cast<eight*>(&adj_vector.data[0][0]);
    for (int axis = 0; axis < 3; ++axis) {
        u[axis] += r * direction.c[axis];
        for (int lane = 0; lane < 8; ++lane)
            adj_direction.c[axis] += r[lane] * p[axis][lane];
    }
    """,
)
def reach_along(vector: Lanes3, direction: wp.vec3) -> Lanes:  # noqa: F811 - an overload
    """Return the component of each lane's vector along a direction."""
    ...


@wp.func
def scaled(vector: wp.vec3, factor: float):
    """Return a vector times a factor."""
    return factor * vector


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight f = *reinterpret_cast<const eight*>(&factor.c[0]);
    const eight* p = reinterpret_cast<const eight*>(&vector.data[0][0]);
    wp::mat_t<3, 8, wp::float32> result;
    eight* r = reinterpret_cast<eight*>(&result.data[0][0]);
    r[0] = f * p[0];
    r[1] = f * p[1];
    r[2] = f * p[2];
    return result;
    """,
    adj_snippet="""
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight f = *reinterpret_cast<const eight*>(&factor.c[0]);
    const eight* p = reinterpret_cast<const eight*>(&vector.data[0][0]);
    const eight* r = reinterpret_cast<const eight*>(&adj_ret.data[0][0]);
    for (int axis = 0; axis < 3; ++axis)
        reinterpret_cast<eight*>(&adj_vector.data[0][0])[axis] += f * r[axis];
    *reinterpret_cast<eight*>(&adj_factor.c[0]) += p[0] * r[0] + p[1] * r[1] + p[2] * r[2];
    """,
)
def scaled(vector: Lanes3, factor: Lanes) -> Lanes3:  # noqa: F811 - an overload
    """Return each lane's vector times its own factor."""
    ...


@wp.func_native(
    """
    #pragma clang fp contract(fast)
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight f = *reinterpret_cast<const eight*>(&factor.c[0]);
    const eight* p = reinterpret_cast<const eight*>(&vector.data[0][0]);
    const eight* q = reinterpret_cast<const eight*>(&total.data[0][0]);
    wp::mat_t<3, 8, wp::float32> result;
    eight* r = reinterpret_cast<eight*>(&result.data[0][0]);
    r[0] = q[0] + f * p[0];
    r[1] = q[1] + f * p[1];
    r[2] = q[2] + f * p[2];
    return result;
    """,
    adj_snippet="""
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight f = *reinterpret_cast<const eight*>(&factor.c[0]);
    const eight* p = reinterpret_cast<const eight*>(&vector.data[0][0]);
    const eight* r = reinterpret_cast<const eight*>(&adj_ret.data[0][0]);
    eight* u = reinterpret_cast<eight*>(&adj_vector.data[0][0]);
    eight* v = reinterpret_cast<eight*>(&adj_total.data[0][0]);
    for (int axis = 0; axis < 3; ++axis) {
        u[axis] += f * r[axis];
        v[axis] += r[axis];
    }
    *reinterpret_cast<eight*>(&adj_factor.c[0]) += p[0] * r[0] + p[1] * r[1] + p[2] * r[2];
    """,
)
def plus_scaled(total: Lanes3, vector: Lanes3, factor: Lanes) -> Lanes3:
    """Return a vector plus another times each lane's own factor, as a fused multiply-add where a CPU has one."""
    ...


@wp.func
def scaled(number: Lanes, factor: Lanes):  # noqa: F811 - an overload
    """Return each lane's number times its own factor."""
    return wp.cw_mul(number, factor)


@wp.func
def scaled(fives: Lanes5, factor: Lanes):  # noqa: F811 - an overload
    """Return each lane's five numbers times its own factor."""
    for row in range(5):
        fives[row] = wp.cw_mul(fives[row], factor)
    return fives


@wp.func
def scaled(vector: Lanes3, factor: float):  # noqa: F811 - an overload
    """Return each lane's vector times one factor."""
    return factor * vector


@wp.func
def length_of(vector: wp.vec3):
    """Return |v|."""
    return wp.length(vector)


@wp.func
def length_of(vectors: Lanes3):  # noqa: F811 - an overload
    """Return |v| in each lane."""
    lengths = Lanes()
    for lane in range(LANE_COUNT):
        lengths[lane] = wp.length(of_lane(vectors, lane))
    return lengths


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    wp::vec_t<8, wp::float32> result;
    *reinterpret_cast<eight*>(&result.c[0]) = __builtin_elementwise_max(
        *reinterpret_cast<const eight*>(&a.c[0]), *reinterpret_cast<const eight*>(&b.c[0]));
    return result;
    """,
    adj_snippet="for (int k = 0; k < 8; ++k) (a.c[k] > b.c[k] ? adj_a : adj_b).c[k] += adj_ret.c[k];",
)
def larger(a: Lanes, b: Lanes) -> Lanes:
    """Return the larger number in each lane."""
    ...


@wp.func
def squared_length(d: wp.vec3):
    """Return |d|^2, and a little more, so that its root can be divided by."""
    return d[0] * d[0] + (d[1] * d[1] + (d[2] * d[2] + NOT_QUITE_ZERO))


@wp.func_native(
    """
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight* p = reinterpret_cast<const eight*>(&d.data[0][0]);
    wp::vec_t<8, wp::float32> result;
    *reinterpret_cast<eight*>(&result.c[0]) = p[0] * p[0] + (p[1] * p[1] + (p[2] * p[2] + 1.0e-20f));
    return result;
    """,
    adj_snippet="""
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    const eight* p = reinterpret_cast<const eight*>(&d.data[0][0]);
    const eight r = *reinterpret_cast<const eight*>(&adj_ret.c[0]);
    for (int axis = 0; axis < 3; ++axis)
        reinterpret_cast<eight*>(&adj_d.data[0][0])[axis] += 2.0f * r * p[axis];
    """,
)
def squared_length(d: Lanes3) -> Lanes:  # noqa: F811 - an overload
    """Return the squared length in each lane, plus a small addend, so that its root can be a divisor.

    It rounds as for one vector, so that springs near their rest length pull alike in every schedule.
    """
    ...
