/* A search for a profile, for those that have several of paths that are alike. */
#ifndef ORIENTD_PROFILE_SEARCH_H
#define ORIENTD_PROFILE_SEARCH_H

#include "profile.h"

enum {
    SPOTS = 3,   /* of an element */
    BENDS = 5,   /* limits of accelerations, at most */
    TWISTS = 4,  /* of jerks */
};

/* The rows of numbers of a search: n or n + 1 or n + 2 each. */
typedef struct {
    const profile_path_t *path;
    index_t n;
    const double *h;
    double *near, *far, *rise;        /* value and slope at a node from two coefficients */
    double *value, *slope;            /* of a profile at the nodes */
    double *y[SPOTS], *d[SPOTS], *b;  /* value, slope and bend in the elements */
    double *top[SPOTS];               /* one over the largest y */
    double *bends[SPOTS][BENDS][3];   /* products of the columns of a limited rate */
    double *twists[SPOTS][TWISTS][6];
    int bend_count, twist_count;
    double weight;                    /* of the barrier, when the search ended */
    double *memory;
    double *g[3], *m[6];              /* gradient and Hessian at one spot of the elements */
    double *lg[3], *lm[6];            /* the same by the three coefficients of each element */
    double *diagonal, *beside, *apart, *right, *step, *trial, *slack;
} search_t;

/* Allocate memory for the search, for as many elements and rates as the path has.  The caller frees
 * it.  Return false if memory is short. */
bool new_search(search_t *s, const profile_path_t *path, const rate_t *rates, int count);
void free_search(search_t *s);

/* Fill in the values that depend on the path alone. */
void put_path(search_t *s, const rate_t *rates, int count);

/* Write value and slope of a profile at the nodes, and what it is in the elements. */
void spread(const search_t *s, const double *restrict c);

/* Return the duration of the profile that is spread. */
double duration(const search_t *s);

/* Return duration and barrier of the profile that is spread, infinite outside. */
double cost_of(const search_t *s, double weight, double stretch);

/* Improve a profile as find_profile does; it is spread then. */
int improve(search_t *s, double begin, double gap, double *c);

#endif
