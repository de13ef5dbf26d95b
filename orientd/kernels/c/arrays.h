/* Arrays as kernels take them: C-contiguous float64 or int64 of one to three dimensions.
 *
 * A kernel never frees or grows what it was given.  Scratch memory is taken from the heap and
 * given back; a kernel that cannot have it returns OUT_OF_MEMORY, which becomes a MemoryError.
 */
#ifndef ORIENTD_ARRAYS_H
#define ORIENTD_ARRAYS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* A hint is not enough: one helper left as a call costs a loop its vector instructions. */
#define INLINE static inline __attribute__((always_inline))

/* Before a loop whose rounds do not depend on what others write, which no compiler can see where
 * ten rows of one array are written. */
#ifdef __clang__
#define INDEPENDENT _Pragma("clang loop vectorize(assume_safety)")
#else
#define INDEPENDENT _Pragma("GCC ivdep")
#endif

typedef int64_t index_t;

typedef struct { double *v; index_t n; } row_t;           /* n numbers */
typedef struct { double *v; index_t n, m; } matrix_t;     /* n rows of m numbers */
typedef struct { double *v; index_t n, m, k; } tensor_t;  /* n matrices of m rows of k numbers */
typedef struct { int64_t *v; index_t n; } indices_t;

enum { OUT_OF_MEMORY = -2 };

INLINE double *row_of(matrix_t a, index_t i) { return a.v + i * a.m; }

/* As fmax and fmin, without a call; the second one where one of them is not a number. */
INLINE double larger(double a, double b) { return a > b ? a : b; }
INLINE double smaller(double a, double b) { return a < b ? a : b; }

INLINE index_t least(index_t a, index_t b) { return a < b ? a : b; }
INLINE index_t most(index_t a, index_t b) { return a > b ? a : b; }

/* The piece that an instant is in: the first before all of them, and the last from its begin on.
 *
 * breaks: where the pieces begin and end, increasing, shape (m + 1,), m > 0. */
INLINE index_t piece_of(double t, row_t breaks) {
    const double *low = breaks.v;
    for (index_t n = breaks.n - 1; n > 1;) {
        index_t half = n / 2;
        low = low[half] <= t ? low + half : low;
        n -= half;
    }
    return low - breaks.v;
}

#endif
