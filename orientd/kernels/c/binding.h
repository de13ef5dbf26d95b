/* How a kernel is called from Python: arguments by position, read by a format, a letter each.
 *
 * d is a float, i an integer, p a truth; v, m, t a float64 array of one, two or three dimensions,
 * x an int64 array of one.  A capital letter means that it is written to.  Arrays are
 * C-contiguous; anything else is a TypeError.
 *
 *     KERNEL(sample_trajectory) {
 *         TAKE("vvmdM");                   arguments are a[0].v, a[1].v, a[2].m ...
 *         CHECK(a[2].m.m == PIECE);         a condition on shapes, or a ValueError
 *         index_t place;
 *         RUN(place = sample_trajectory(...));  without the interpreter's lock; lets the arrays go
 *         return PyLong_FromLongLong(place);
 *     }
 */
#ifndef ORIENTD_BINDING_H
#define ORIENTD_BINDING_H

#include "arrays.h"
#include "stable_abi.h"

enum { MOST_ARGUMENTS = 20 };

typedef struct {
    union { double d; index_t i; bool p; row_t v; matrix_t m; tensor_t t; indices_t x; };
} argument_t;

typedef struct {
    argument_t at[MOST_ARGUMENTS];
    Py_buffer buffers[MOST_ARGUMENTS];
    int held;
} arguments_t;

/* Read arguments; where that fails an exception is set and nothing is held. */
bool take(PyObject *const *given, Py_ssize_t count, const char *format, arguments_t *taken);
/* Let the arrays go. */
void release(arguments_t *taken);
/* Say that shapes do not belong together, and let the arrays go. */
PyObject *refuse(arguments_t *taken);

#define KERNEL(NAME) \
    static PyObject *py_##NAME(PyObject *self, PyObject *const *given, Py_ssize_t count)
#define TAKE(FORMAT) \
    (void)self; \
    arguments_t taken; \
    if (!take(given, count, FORMAT, &taken)) \
        return NULL; \
    argument_t *a = taken.at; \
    (void)a
#define CHECK(CONDITION) \
    if (!(CONDITION)) \
        return refuse(&taken)
#define RUN(STATEMENT) \
    do { \
        Py_BEGIN_ALLOW_THREADS STATEMENT; \
        Py_END_ALLOW_THREADS release(&taken); \
    } while (0)
/* The same with the interpreter's lock, for a cycle of the servo, which must not wait to get it back. */
#define RUN_AT_ONCE(STATEMENT) \
    do { \
        STATEMENT; \
        release(&taken); \
    } while (0)
/* An entry of a table of methods. */
#define ENTRY(NAME) {#NAME, (PyCFunction)(void (*)(void))py_##NAME, METH_FASTCALL, NULL}
#define LAST_ENTRY {NULL, NULL, 0, NULL}

/* One table for each group of kernels, in py_<group>.c. */
extern PyMethodDef interpolation_methods[];
extern PyMethodDef trajectory_methods[];
extern PyMethodDef connectors_methods[];
extern PyMethodDef certify_methods[];
extern PyMethodDef mechanism_methods[];
extern PyMethodDef timing_methods[];

#endif
