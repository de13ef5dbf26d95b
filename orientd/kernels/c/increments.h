/* Newton steps of the equations of an interpolating spline, for who searches its increments. */
#ifndef ORIENTD_INCREMENTS_H
#define ORIENTD_INCREMENTS_H

#include "interpolation.h"
#include "rotation.h"

/* Rows by which the strands of newton_step overlap: what that leaves of a correction, some 1e-7 of
 * it, the next one takes. */
enum { SHORT_RUN = 12 };

/* What a step is worked out in. */
typedef struct strands strands_t;

/* Return memory for steps whose strands overlap by so many rows, to be freed; NULL without any.
 *
 * more: how many bytes are wanted behind it: a system keeps one large piece at hand, not several.
 * rest: receives where they begin, or is NULL. */
strands_t *new_strands(index_t run, size_t more, void **rest);

/* Write a Newton step of some rows and return its largest component, as keyframe_step does.
 *
 * strands: of SHORT_RUN. */
double newton_step(const equations_t *equations, double scale, matrix_t unknown, indices_t rows,
                   strands_t *strands, double *correction);

/* Return the first or last step with what two known increments turn taken off. */
vec_t end_step(const equations_t *equations, double scale, index_t row);

#endif
