"""Powers by logarithms and exponentials that the compiler knows.

A GPU has instructions for both, and on a CPU they are arithmetic that vectorizes over eight lanes, which a call of the
library's `pow` is not.
"""

import warp as wp


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
