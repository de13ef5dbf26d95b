/* How arguments are read; see binding.h. */
#include "binding.h"

#include <string.h>

void release(arguments_t *taken) {
    while (taken->held)
        PyBuffer_Release(&taken->buffers[--taken->held]);
}

static bool take_array(PyObject *given, char letter, arguments_t *taken, argument_t *to) {
    char kind = (char)(letter | 0x20);
    int writable = letter == kind ? 0 : PyBUF_WRITABLE;
    Py_buffer *buffer = &taken->buffers[taken->held];
    if (PyObject_GetBuffer(given, buffer, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | writable) < 0)
        return false;
    taken->held++;
    int dimensions = kind == 'm' ? 2 : kind == 't' ? 3 : 1;
    const char *type = buffer->format != NULL ? buffer->format : "B";
    bool fits = kind == 'x' ? !strcmp(type, "l") || !strcmp(type, "q") : !strcmp(type, "d");
    if (!fits || buffer->ndim != dimensions || buffer->itemsize != 8) {
        PyErr_Format(PyExc_TypeError, "expected %d dimensions of %s, got %d of %s", dimensions,
                     kind == 'x' ? "int64" : "float64", buffer->ndim, type);
        return false;
    }
    const Py_ssize_t *shape = buffer->shape;
    switch (kind) {
    case 'm': to->m = (matrix_t){buffer->buf, shape[0], shape[1]}; break;
    case 't': to->t = (tensor_t){buffer->buf, shape[0], shape[1], shape[2]}; break;
    case 'x': to->x = (indices_t){buffer->buf, shape[0]}; break;
    default: to->v = (row_t){buffer->buf, shape[0]};
    }
    return true;
}

bool take(PyObject *const *given, Py_ssize_t count, const char *format, arguments_t *taken) {
    taken->held = 0;
    if (count != (Py_ssize_t)strlen(format)) {
        PyErr_Format(PyExc_TypeError, "expected %zu arguments, got %zd", strlen(format), count);
        return false;
    }
    for (Py_ssize_t i = 0; i < count; i++) {
        argument_t *to = &taken->at[i];
        bool failed;
        switch (format[i]) {
        case 'd': to->d = PyFloat_AsDouble(given[i]); failed = PyErr_Occurred() != NULL; break;
        case 'i': to->i = PyLong_AsLongLong(given[i]); failed = PyErr_Occurred() != NULL; break;
        case 'p': {
            int truth = PyObject_IsTrue(given[i]);
            to->p = truth > 0;
            failed = truth < 0;
            break;
        }
        default: failed = !take_array(given[i], format[i], taken, to);
        }
        if (failed) {
            release(taken);
            return false;
        }
    }
    return true;
}

PyObject *refuse(arguments_t *taken) {
    release(taken);
    PyErr_SetString(PyExc_ValueError, "the shapes do not belong together");
    return NULL;
}
