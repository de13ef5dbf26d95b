/* The module: every kernel, and what it was built from. */
#include "binding.h"

static int set_up(PyObject *module) {
    PyMethodDef *groups[] = {trajectory_methods, certify_methods,
                             connectors_methods, interpolation_methods, mechanism_methods,
                             timing_methods};
    for (size_t i = 0; i < sizeof groups / sizeof *groups; i++)
        if (PyModule_AddFunctions(module, groups[i]) < 0)
            return -1;
    if (PyModule_AddStringConstant(module, "SOURCES", ORIENTD_SOURCES) < 0)
        return -1;
    return PyModule_AddStringConstant(module, "LEVEL", ORIENTD_LEVEL);
}

static PyModuleDef_Slot slots[] = {{Py_mod_exec, set_up}, {0, NULL}};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, .m_name = "native", .m_size = 0, .m_slots = slots,
};

PyMODINIT_FUNC PyInit_native(void) { return PyModuleDef_Init(&definition); }
