/* Options that change results are refused: the program means IEEE 754 arithmetic, each operation
 * rounded once, in the order written. Emitted sources hold a copy of this. */
#if defined(__FAST_MATH__) || defined(_M_FP_FAST) || defined(__RECIPROCAL_MATH__) || \
    defined(__ASSOCIATIVE_MATH__) || defined(__NO_SIGNED_ZEROS__)
#error "compile controllers without -ffast-math and its parts, which change results"
#endif
#if defined(__FINITE_MATH_ONLY__)
#if __FINITE_MATH_ONLY__
#error "compile controllers without -ffinite-math-only, which loses missing readings"
#endif
#endif

/* No fused multiply-add. Where gcc would contract (-std=gnu99 and later) it heeds its own pragma. */
#if defined(__GNUC__) && !defined(__clang__)
#if !defined(__STRICT_ANSI__)
#pragma GCC optimize("fp-contract=off")
#endif
#else
#pragma STDC FP_CONTRACT OFF
#endif

/* A program may compare a value with itself, or overflow, and mean it. */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wtautological-compare"
#pragma GCC diagnostic ignored "-Woverflow"
#endif
