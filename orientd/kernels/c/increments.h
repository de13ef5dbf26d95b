/* Newton steps of some rows of the equations of a spline, for who searches its increments. */
#ifndef ORIENTD_INCREMENTS_H
#define ORIENTD_INCREMENTS_H

#include "interpolation.h"
#include "rotation.h"

enum {
    LANES = 8,
    OVERLAP = 12, /* places that strands overlap by: what lies beyond decays by 0.27 with each */
    ALONE = 36,   /* items that are not worth a second strand */
};

typedef double lanes_t[LANES];

/* An item whose correction is settled by those of its neighbours, multiples of them or none. */
typedef struct { index_t item; double of_before, of_after; } tie_t;

/* Some rows of a system, with everything that is wanted of them side by side.
 *
 * Its items are the unknowns of the rows and those beside them, which stand still, in order; those
 * before the first and after the last unknown of the system count as unknowns -1 and N.  They are
 * worked off in strands, one for each lane of the vector units: item i * length + p is at place p of
 * lane i.  Places that are left over behind the last item stand still at zero.  All arrays have a
 * place for each of a strand; increments and shares have one more at either end, which the strands
 * beside it own. */
typedef struct {
    const equations_t *equations;
    index_t count;    /* of items */
    index_t length;   /* of a strand */
    index_t ties;
    int64_t *which;   /* the unknown that an item is */
    tie_t *tie;
    lanes_t (*w)[3];      /* the increments */
    lanes_t (*shares)[2]; /* how much of each is turned at the keyframes before and after it */
    lanes_t (*step)[3];   /* half-angle vectors from keyframe to keyframe, of full scale */
    lanes_t (*target)[4]; /* quaternions of the scaled steps */
    lanes_t (*error)[3];  /* half-angle vectors by which rows miss them */
    lanes_t (*system)[30]; /* blocks left of, on and right of the diagonal by columns, right side */
    lanes_t (*kept)[12];   /* the block on the right and the correction, both divided */
    lanes_t (*tangent)[3], (*bend)[3], (*bend_before)[3]; /* the way; see search.c */
    void *memory;
} window_t;

/* Take memory for windows of a system and return whether there was any; to be freed. */
bool new_window(const equations_t *equations, window_t *window);

/* Load rows.
 *
 * scale: of the steps and of what is known at the ends.
 * moves: whether an unknown is to be corrected, for each from -2 to N + 1; false for those that do
 *     not belong to the system. */
void open_window(window_t *window, double scale, matrix_t unknown, const bool *moves);

/* Load increments of the items: unknowns, and what goes with them at the ends.
 *
 * scale: of what is known there. */
void load_items(const window_t *window, double scale, matrix_t from, lanes_t (*to)[3]);

/* Write the increments of the rows. */
void close_window(const window_t *window, const bool *moves, matrix_t unknown);

/* Write the scaled steps. */
void put_targets(window_t *window, double scale);

/* Correct the increments by a Newton step, and return its largest component; not a number where one
 * is not finite.
 *
 * What the strands do not know of each other leaves some 1e-7 of the step, which the next one takes.
 * The corrections stand at the end of what is kept. */
double newton_step(window_t *window);

/* The correction at a place of a lane. */
INLINE vec_t correction_at(const window_t *window, index_t i, index_t p) {
    lanes_t *v = window->kept[p] + 9;
    return vec(v[0][i], v[1][i], v[2][i]);
}

/* Return the first or last step with what two known increments turn taken off. */
vec_t end_step(const equations_t *equations, double scale, index_t row);

#endif
