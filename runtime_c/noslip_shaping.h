/*
 * noslip_shaping.h - inputs with which the wheels keep rolling, for robots with more than two inputs.
 *
 * Where there are more inputs than n - m, many inputs give the same motion, and their difference shapes the forces of the ground.
 * A step with options.on_limit = NOSLIP_GRIP first uses this freedom, then gives up the desired speed, then goes towards coasting;
 * see noslip_grip.h.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_SHAPING_H
#define NOSLIP_SHAPING_H

#include "noslip_grip.h"
#include "noslip_solve.h"

/* -- double: generated from noslip_shaping.inc by guarantees/headers.py ------------------------------------------------ */

/*
 * Computes the way of `count` inputs, or of their combinations, to the smallest sum of (F / mass)^2 over the contacts, where F is the
 * force of `ground`, or with `along` that by these inputs. The rows of `free` are the combinations, their coefficients count as the
 * inputs do; NULL: each input by itself. What the inputs do to the forces is to be large beside 1 % of what they do on average: the
 * sum has in addition 1e-4 of the mean effect times the sum of their squares, so that inputs without effect do not change. `work`
 * is memory for count (count + 2) numbers.
 */
NOSLIP_APART void noslip_way_to_least(const double *ground, const double *along, const double *free,
                       const double *by_inputs, int contacts, int count, double *work,
                       double *way)
{
    double *normal = work, *right = work + count * count, *effect = right + count;
    double trace = 0;
    int i, j, k;
    noslip_write_zeros(work, count * (count + 1));
    for (k = 0; k < 2 * contacts; k++) {
        const double *at = ground + 4 * (k / 2), *by = by_inputs + (3 * (k / 2) + k % 2) * count;
        const double light = noslip_per_mass(at[3]);
        const double force = (along == NULL ? at[k % 2] : noslip_effect(by, along, count)) * light;
        for (i = 0; i < count; i++) {
            effect[i] = (free == NULL ? by[i] : noslip_effect(by, free + i * count, count)) * light;
            right[i] -= effect[i] * force;
            trace += effect[i] * effect[i];
            for (j = 0; j <= i; j++) {
                normal[i * count + j] += effect[i] * effect[j];
            }
        }
    }
    for (i = 0; i < count; i++) {
        normal[i * count + i] += (double)1e-4 * trace / (double)count;
    }
    if (noslip_ldl(normal, count) == NOSLIP_OK) {
        noslip_ldl_solve(normal, right, count);
    } else {
        noslip_write_zeros(right, count);
    }
    for (i = 0; i < count; i++) {
        way[i] = free == NULL ? right[i] : 0;
        for (j = 0; free != NULL && j < count; j++) {
            way[i] += right[j] * free[j * count + i];
        }
    }
}

/*
 * As noslip_keep_grip, for `count` inputs, two or more. `free` (NULL: there are none) has as its rows `count` combinations of inputs
 * that do not change the motion. With it the inputs first go towards the smallest sum of (F / mass)^2 that leaves the motion as it is,
 * as little as needed; if that is not enough, `slope` is followed where this sum is smallest for each speed: `slope` is changed.
 * `work` is memory for count (count + 3) numbers and 3 for each contact.
 */
NOSLIP_APART int noslip_keep_grip_of(double *inputs, double *slope, const double *free,
                       double *ground, const double *by_inputs,
                       const noslip_grip *grip, const double *limits, int contacts,
                       int count, double *work)
{
    const noslip_grip below = noslip_grip_below(grip);
    double *way = work + count * (count + 2), *effects = way + count;
    int i, any = 0;
    noslip_write_loads(ground, &below, contacts);
    if (free != NULL) {
        noslip_way_to_least(ground, NULL, free, by_inputs, contacts, count, work, way);
        any = noslip_go_towards(inputs, way, ground, by_inputs, below.height, limits, contacts, count, effects);
    }
    if (!any && slope != NULL) {
        if (free != NULL) {
            noslip_way_to_least(ground, slope, free, by_inputs, contacts, count, work, way);
            for (i = 0; i < count; i++) {
                slope[i] += way[i];
            }
        }
        any = noslip_go_along(inputs, slope, ground, by_inputs, below.height, limits, contacts, count, effects);
    }
    if (!any) {
        noslip_way_to_least(ground, NULL, NULL, by_inputs, contacts, count, work, way);
        (void)noslip_go_towards(inputs, way, ground, by_inputs, below.height, limits, contacts, count, effects);
    }
    return noslip_cut(inputs, limits, count);
}

/* -- float: generated from noslip_shaping.inc by guarantees/headers.py ------------------------------------------------- */

/*
 * Computes the way of `count` inputs, or of their combinations, to the smallest sum of (F / mass)^2 over the contacts, where F is the
 * force of `ground`, or with `along` that by these inputs. The rows of `free` are the combinations, their coefficients count as the
 * inputs do; NULL: each input by itself. What the inputs do to the forces is to be large beside 1 % of what they do on average: the
 * sum has in addition 1e-4 of the mean effect times the sum of their squares, so that inputs without effect do not change. `work`
 * is memory for count (count + 2) numbers.
 */
NOSLIP_APART void noslip_way_to_least_f(const float *ground, const float *along, const float *free,
                      const float *by_inputs, int contacts, int count, float *work,
                      float *way)
{
    float *normal = work, *right = work + count * count, *effect = right + count;
    float trace = 0;
    int i, j, k;
    noslip_write_zeros_f(work, count * (count + 1));
    for (k = 0; k < 2 * contacts; k++) {
        const float *at = ground + 4 * (k / 2), *by = by_inputs + (3 * (k / 2) + k % 2) * count;
        const float light = noslip_per_mass_f(at[3]);
        const float force = (along == NULL ? at[k % 2] : noslip_effect_f(by, along, count)) * light;
        for (i = 0; i < count; i++) {
            effect[i] = (free == NULL ? by[i] : noslip_effect_f(by, free + i * count, count)) * light;
            right[i] -= effect[i] * force;
            trace += effect[i] * effect[i];
            for (j = 0; j <= i; j++) {
                normal[i * count + j] += effect[i] * effect[j];
            }
        }
    }
    for (i = 0; i < count; i++) {
        normal[i * count + i] += (float)1e-4 * trace / (float)count;
    }
    if (noslip_ldl_f(normal, count) == NOSLIP_OK) {
        noslip_ldl_solve_f(normal, right, count);
    } else {
        noslip_write_zeros_f(right, count);
    }
    for (i = 0; i < count; i++) {
        way[i] = free == NULL ? right[i] : 0;
        for (j = 0; free != NULL && j < count; j++) {
            way[i] += right[j] * free[j * count + i];
        }
    }
}

/*
 * As noslip_keep_grip, for `count` inputs, two or more. `free` (NULL: there are none) has as its rows `count` combinations of inputs
 * that do not change the motion. With it the inputs first go towards the smallest sum of (F / mass)^2 that leaves the motion as it is,
 * as little as needed; if that is not enough, `slope` is followed where this sum is smallest for each speed: `slope` is changed.
 * `work` is memory for count (count + 3) numbers and 3 for each contact.
 */
NOSLIP_APART int noslip_keep_grip_of_f(float *inputs, float *slope, const float *free,
                      float *ground, const float *by_inputs,
                      const noslip_grip_f *grip, const float *limits, int contacts,
                      int count, float *work)
{
    const noslip_grip_f below = noslip_grip_below_f(grip);
    float *way = work + count * (count + 2), *effects = way + count;
    int i, any = 0;
    noslip_write_loads_f(ground, &below, contacts);
    if (free != NULL) {
        noslip_way_to_least_f(ground, NULL, free, by_inputs, contacts, count, work, way);
        any = noslip_go_towards_f(inputs, way, ground, by_inputs, below.height, limits, contacts, count, effects);
    }
    if (!any && slope != NULL) {
        if (free != NULL) {
            noslip_way_to_least_f(ground, slope, free, by_inputs, contacts, count, work, way);
            for (i = 0; i < count; i++) {
                slope[i] += way[i];
            }
        }
        any = noslip_go_along_f(inputs, slope, ground, by_inputs, below.height, limits, contacts, count, effects);
    }
    if (!any) {
        noslip_way_to_least_f(ground, NULL, NULL, by_inputs, contacts, count, work, way);
        (void)noslip_go_towards_f(inputs, way, ground, by_inputs, below.height, limits, contacts, count, effects);
    }
    return noslip_cut_f(inputs, limits, count);
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
