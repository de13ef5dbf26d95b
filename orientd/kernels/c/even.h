/* The shortest duration of a trajectory at its own pace, slowed down by one factor.
 *
 * Finding it takes several looks at the records of a motion.  A motion of hours has millions of them,
 * but only near its largest rates do they matter: these spots are found from the derivatives at a few
 * instants of every piece, and nothing else is looked at.  The certificate looks at everything in
 * the end.
 */
#ifndef ORIENTD_EVEN_H
#define ORIENTD_EVEN_H

#include "arrays.h"

/* What is looked at.
 *
 * breaks, pieces: the trajectory by path time from 0 on, see trajectory.h.
 * knots: path times at which a derivative may have a step, both ends included.
 * move_breaks, moves: the position, as in timing.h.
 * limits: of velocity, acceleration and jerk, of the norm and the components, shape (3, 4).
 * move_limits: of the position's velocity and acceleration, shape (2,).
 * period: of the device, s.
 * is_held: whether the device holds before the first record, and after the last one.
 * tolerance: factor by which what is drawn between the records may exceed the limits.
 * more: how much larger acceleration and jerk may be between the records than on them.
 * step: what the jerk of a step of the acceleration over a period is multiplied by; 0 if there is no
 *     such step, and jerks fall with the third power of the duration, not the second.
 * has_one_shape: whether another duration is the same path at another rate.
 * is_everywhere: whether to look at every record. */
typedef struct {
    row_t breaks;
    matrix_t pieces;
    row_t knots, move_breaks;
    matrix_t moves, limits;
    row_t move_limits;
    double period;
    bool is_held[2];
    double tolerance, more[2], step;
    bool has_one_shape, is_everywhere;
} even_t;

/* The result of the search.
 *
 * cycles: the fewest that keep the limits, to 0.1 %; 0 if the search finds none.
 * factor: the last motion that was checked should take longer by this factor.
 * coarse: the same factor for the trajectory's own duration, from the instants alone. */
typedef struct { index_t cycles; double factor, coarse; } even_pace_t;

/* More cycles are not looked for. */
#define MOST_CYCLES 10000000000

/* Find the fewest cycles between *least* and *most*, beginning with the guess *first*.  If *first* is
 * 0, the instants give the guess.  If *least* equals *most*, only check that number of cycles.
 *
 * Return 0 or OUT_OF_MEMORY. */
int time_even(const even_t *asked, index_t first, index_t least, index_t most, even_pace_t *found);

#endif
