/* The part of Python's stable ABI (3.11 and newer) that the kernels use.
 *
 * These declarations replace Python's own headers.  Many machines with a compiler lack those headers,
 * and a build for another architecture would need the headers of that one.  The stable ABI cannot
 * change without breaking every abi3 library.  tests/unit/kernels/test_stable_abi.py compares this
 * file with <Python.h>, and a source may include both.
 */
#ifndef ORIENTD_STABLE_ABI_H
#define ORIENTD_STABLE_ABI_H

#include <stddef.h>
#include <sys/types.h>

#ifndef Py_PYTHON_H

typedef ssize_t Py_ssize_t;
typedef struct _object PyObject;
typedef struct _ts PyThreadState;

struct _object { Py_ssize_t ob_refcnt; void *ob_type; };

typedef struct {
    void *buf;
    PyObject *obj;
    Py_ssize_t len, itemsize;
    int readonly, ndim;
    char *format;
    Py_ssize_t *shape, *strides, *suboffsets;
    void *internal;
} Py_buffer;

typedef PyObject *(*PyCFunction)(PyObject *, PyObject *);

typedef struct {
    const char *ml_name;
    PyCFunction ml_meth;
    int ml_flags;
    const char *ml_doc;
} PyMethodDef;

typedef struct { int slot; void *value; } PyModuleDef_Slot;

typedef struct PyModuleDef {
    struct { PyObject ob_base; void *m_init; Py_ssize_t m_index; PyObject *m_copy; } m_base;
    const char *m_name, *m_doc;
    Py_ssize_t m_size;
    PyMethodDef *m_methods;
    PyModuleDef_Slot *m_slots;
    void *m_traverse, *m_clear, *m_free;
} PyModuleDef;

enum {
    PyBUF_WRITABLE = 1, PyBUF_FORMAT = 4, PyBUF_C_CONTIGUOUS = 0x38,
    METH_FASTCALL = 0x80,
    Py_mod_exec = 2,
};

#define PyModuleDef_HEAD_INIT {{1, NULL}, NULL, 0, NULL}
#define PyMODINIT_FUNC __attribute__((visibility("default"))) PyObject *

#define Py_BEGIN_ALLOW_THREADS { PyThreadState *_save = PyEval_SaveThread();
#define Py_END_ALLOW_THREADS PyEval_RestoreThread(_save); }

#define Py_None (&_Py_NoneStruct)
#define Py_RETURN_NONE return Py_NewRef(Py_None)

extern PyObject *Py_NewRef(PyObject *object);

#endif

extern PyObject _Py_NoneStruct;
extern PyObject *PyExc_MemoryError, *PyExc_TypeError, *PyExc_ValueError;

extern int PyObject_GetBuffer(PyObject *object, Py_buffer *buffer, int flags);
extern void PyBuffer_Release(Py_buffer *buffer);
extern int PyObject_IsTrue(PyObject *object);
extern double PyFloat_AsDouble(PyObject *number);
extern long long PyLong_AsLongLong(PyObject *number);
extern PyObject *PyFloat_FromDouble(double value);
extern PyObject *PyLong_FromLongLong(long long value);
extern PyObject *PyBool_FromLong(long value);
extern PyObject *PyBytes_FromStringAndSize(const char *bytes, Py_ssize_t size);
extern PyObject *Py_BuildValue(const char *format, ...);

extern PyObject *PyErr_Occurred(void);
extern PyObject *PyErr_NoMemory(void);
extern PyObject *PyErr_Format(PyObject *type, const char *format, ...);
extern void PyErr_SetString(PyObject *type, const char *message);

extern PyThreadState *PyEval_SaveThread(void);
extern void PyEval_RestoreThread(PyThreadState *state);

extern PyObject *PyModuleDef_Init(struct PyModuleDef *definition);
extern int PyModule_AddFunctions(PyObject *module, PyMethodDef *functions);
extern int PyModule_AddStringConstant(PyObject *module, const char *name, const char *value);

#endif
