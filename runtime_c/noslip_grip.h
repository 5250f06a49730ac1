/*
 * noslip_grip.h - inputs with which the wheels keep rolling.
 *
 * The force of the ground at each contact is affine in the inputs; rolling holds while its size is at most mu times the load there,
 * a convex cone. Along a line of inputs each cone is an interval, from one square root. Used by the step of a law with
 * options.on_limit = NOSLIP_GRIP:
 *
 *     labmate_options options = {.on_limit = NOSLIP_GRIP, .friction = {.mu = 0.6, .margin = 0.1, .height = 0.2}};
 *
 * The step returns NOSLIP_GRIP_LIMITED if it changed the inputs so that the wheels roll, and NOSLIP_WILL_SLIP if no inputs on the way
 * to coasting keep them rolling. What is given up first: the desired speed, then everything in favour of coasting.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_GRIP_H
#define NOSLIP_GRIP_H

#include "noslip_controller.h"

#define NOSLIP_GRAVITY 9.81 /* m/s^2 */

/* -- double: generated from noslip_grip.inc by guarantees/headers.py --------------------------------------------------- */

/* What a controller believes of friction; all zero: no limit of friction. */
typedef struct noslip_friction {
    double mu;          /* coefficient of friction between wheels and floor */
    double margin;      /* part of mu that is kept in reserve, from 0 to less than 1 */
    double share;       /* part of the weight that rests on the contacts of the model, at most 1; 0: all of it */
    double height;      /* m: of the centre of mass above the floor, which moves load to the outer wheels of an axle */
} noslip_friction;

/* The same for a step: mu load = weight * mass + height * shift; see noslip_holds. */
typedef struct noslip_grip {
    double weight;      /* m/s^2 */
    double height;      /* m */
} noslip_grip;

/* Returns 1 if the numbers are in their ranges and mu is not zero; `wide` is 0 if an axle cannot carry a height. */
static inline int noslip_friction_ok(const noslip_friction *friction, int wide)
{
    return noslip_is_positive(friction->mu) && friction->margin >= 0 && friction->margin < 1 &&
        friction->share >= 0 && friction->share <= 1 && noslip_is_finite(friction->height) &&
        friction->height >= 0 && (wide || !(friction->height > 0));
}

/* Returns the limit of friction for a step. */
static inline noslip_grip noslip_grip_of(const noslip_friction *friction)
{
    const double mu = friction->mu * (1 - friction->margin);
    noslip_grip grip;
    grip.weight = mu * (friction->share > 0 ? friction->share : 1) * (double)NOSLIP_GRAVITY;
    grip.height = mu * friction->height;
    return grip;
}

/*
 * Returns 1 if the force at a contact is within friction, else 0; 0 for NaN. `ground` is the force along and across (N), the shift of
 * the load by the height (N/m), and the mass (kg). Of forces and loads above 1e-15 N: where it returns 1, the force is at most
 * 1 + DBL_EPSILON times the computed mu load. A difference has the right sign also when rounded, so that x = most^2 - along^2, rounded,
 * is at least across^2, rounded; each of x and the three squares is off by at most half of DBL_EPSILON.
 */
NOSLIP_HOT int noslip_holds(const double *ground, const noslip_grip *grip)
{
    const double most = grip->weight * ground[3] + grip->height * ground[2];
    return most * noslip_abs(most) - ground[0] * ground[0] - ground[1] * ground[1] >= 0;              /* NaN if they overflow */
}

/* Numbers s from low to high; none if low > high. `any` is 0 if some condition holds for no s: then low and high are the s
 * nearest to holding. */
typedef struct noslip_steps {
    double low, high;
    int any;
} noslip_steps;

/* Keeps the s from `low` to `high`. */
static inline void noslip_narrow(noslip_steps *steps, double low, double high)
{
    steps->low = low > steps->low ? low : steps->low;
    steps->high = high < steps->high ? high : steps->high;
}

/*
 * Keeps the s with |F + s D| <= N + s M, a convex cone: `at` is (F along, F across, N), `way` is (D along, D across, M). If there
 * are none, keeps the s at which |F + s D|^2 - (N + s M)^2 is smallest.
 */
NOSLIP_APART void noslip_within_cone(noslip_steps *steps, const double *at, const double *way)
{
    const double a = way[0] * way[0] + way[1] * way[1] - way[2] * way[2];      /* a s^2 + 2 b s + c <= 0 */
    const double b = at[0] * way[0] + at[1] * way[1] - at[2] * way[2];
    const double c = at[0] * at[0] + at[1] * at[1] - at[2] * at[2];
    const double square = b * b - a * c, root = noslip_sqrt(square > 0 ? square : 0);
    const double larger = b > 0 ? -(b + root) : root - b;      /* the root of larger size, times a */
    if (a > 0) {
        const double middle = -b / a;
        if (square >= 0 && at[2] + middle * way[2] >= 0) {
            const double one = larger / a, other = noslip_abs(larger) > 0 ? c / larger : 0;
            noslip_narrow(steps, one < other ? one : other, one < other ? other : one);
        } else {
            steps->any = 0;
            noslip_narrow(steps, middle, middle);
        }
    } else if (noslip_abs(larger) > 0) {              /* the load grows faster than the force: a half-line; as fast: or nothing */
        const double other = c / larger, one = a < 0 ? larger / a : other;
        const double end = (way[2] > 0) == (one > other) ? one : other, load = at[2] + end * way[2];
        if (!(load >= 0 && noslip_is_finite(load))) {
            steps->any = 0;
        } else if (way[2] > 0) {
            noslip_narrow(steps, end, DBL_MAX);
        } else {
            noslip_narrow(steps, -DBL_MAX, end);
        }
    } else if (!(c <= 0 && at[2] >= 0)) {
        steps->any = 0;
    }
}

/* Returns the limit of friction less 1024 roundings, so that rounding does not exceed it. */
static inline noslip_grip noslip_grip_below(const noslip_grip *grip)
{
    noslip_grip below;
    below.weight = grip->weight * (1 - 1024 * DBL_EPSILON);
    below.height = grip->height * (1 - 1024 * DBL_EPSILON);
    return below;
}

/* Replaces the shift of the load in `ground`, as in noslip_holds for each contact, by mu load (N): (F along, F across, N, mass). */
static inline void noslip_write_loads(double *ground, const noslip_grip *grip, int contacts)
{
    int k;
    for (k = 0; k < contacts; k++) {
        ground[4 * k + 2] = grip->weight * ground[4 * k + 3] + grip->height * ground[4 * k + 2];
    }
}

/* Returns the sum of by[i] way[i] over `count` inputs, two or more. */
NOSLIP_HOT double noslip_effect(const double *by, const double *way, int count)
{
    double sum = by[0] * way[0] + by[1] * way[1];
    int i;
    for (i = 2; i < count; i++) {
        sum += by[i] * way[i];
    }
    return sum;
}

/* Computes what `way` adds at each contact to (F along, F across, N). `by_inputs` has for each contact the derivatives of the force
 * along and across and of the shift of the load by each of `count` inputs; `height` is that of noslip_grip_below. */
NOSLIP_APART void noslip_effects(const double *way, const double *by_inputs,
                       double height, int contacts, int count, double *effects)
{
    int k;
    for (k = 0; k < contacts; k++) {
        const double *by = by_inputs + 3 * k * count;
        effects[3 * k] = noslip_effect(by, way, count);
        effects[3 * k + 1] = noslip_effect(by + count, way, count);
        effects[3 * k + 2] = height * noslip_effect(by + 2 * count, way, count);
    }
}

/*
 * Returns the s with which the inputs + s `way` keep each contact within friction and each of `count` inputs within its limit.
 * `ground` is that of noslip_write_loads, `effects` that of noslip_effects. Parts of `way` below 1e-5 of the largest count as zero
 * for the limits.
 */
NOSLIP_APART noslip_steps noslip_steps_within(const double *inputs, const double *way,
                                    const double *ground, const double *effects,
                                    const double *limits, int contacts, int count)
{
    noslip_steps steps;
    double largest = 0;
    int i, k;
    steps.low = -DBL_MAX;
    steps.high = DBL_MAX;
    steps.any = 1;
    for (k = 0; k < contacts; k++) {
        noslip_within_cone(&steps, ground + 4 * k, effects + 3 * k);
    }
    for (i = 0; i < count; i++) {
        largest = noslip_abs(way[i]) > largest ? noslip_abs(way[i]) : largest;
    }
    for (i = 0; i < count; i++) {
        if (noslip_abs(way[i]) * 100000 > largest) {
            const double middle = -inputs[i] / way[i], half = limits[i] / noslip_abs(way[i]);
            noslip_narrow(&steps, middle - half, middle + half);
        } else if (!noslip_within(inputs[i], limits[i])) {
            steps.any = 0;
        }
    }
    return steps;
}

/* Adds s `way` to the inputs. */
static inline void noslip_move(double *inputs, const double *way, double s, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        inputs[i] += s * way[i];
    }
}

/* Adds s `effects` to `ground`. */
NOSLIP_APART void noslip_move_ground(double *ground, const double *effects, double s, int contacts)
{
    int k;
    for (k = 0; k < contacts; k++) {
        ground[4 * k] += s * effects[3 * k];
        ground[4 * k + 1] += s * effects[3 * k + 1];
        ground[4 * k + 2] += s * effects[3 * k + 2];
    }
}

/* Returns 1 / mass; 0 if there is none. */
static inline double noslip_per_mass(double mass)
{
    return noslip_abs(mass) > 0 ? 1 / mass : 0;
}

/*
 * Computes the way from two inputs to coasting, where the sum of (F / mass)^2 over the contacts is smallest: one step of
 * least squares. If an input, or a combination of both, has no effect on the forces, goes down the gradient only.
 */
NOSLIP_APART void noslip_way_to_coasting(const double *ground, const double *by_inputs, int contacts,
                                double *way)
{
    double xx = 0, xy = 0, yy = 0, x = 0, y = 0, determinant;
    int i, k;
    for (k = 0; k < contacts; k++) {
        const double light = noslip_per_mass(ground[4 * k + 3]);
        for (i = 0; i < 2; i++) {
            const double *by = by_inputs + 6 * k + 2 * i;
            const double one = by[0] * light, other = by[1] * light, force = ground[4 * k + i] * light;
            xx += one * one;
            xy += one * other;
            yy += other * other;
            x += one * force;
            y += other * force;
        }
    }
    determinant = xx * yy - xy * xy;
    if (determinant > (double)1e-5 * xx * yy) {
        way[0] = (xy * y - yy * x) / determinant;
        way[1] = (xy * x - xx * y) / determinant;
    } else {
        const double bend = xx * x * x + 2 * xy * x * y + yy * y * y, slope = x * x + y * y;
        const double length = bend > 0 ? slope / bend : 0;
        way[0] = -length * x;
        way[1] = -length * y;
    }
}

/* Goes along `way` as little as needed, and returns 1; if nothing there is within friction and limits, goes as near to it as it
 * gets, changes `ground` accordingly, and returns 0. `effects` is memory for 3 numbers for each contact. */
NOSLIP_APART int noslip_go_along(double *inputs, const double *way, double *ground,
                  const double *by_inputs, double height, const double *limits,
                  int contacts, int count, double *effects)
{
    noslip_steps steps;
    double s;
    noslip_effects(way, by_inputs, height, contacts, count, effects);
    steps = noslip_steps_within(inputs, way, ground, effects, limits, contacts, count);
    if (steps.low > steps.high) { /* apart from each other: in the middle between them */
        steps.any = 0;
        s = steps.low / 2 + steps.high / 2;
    } else {
        s = steps.low > 0 ? steps.low : steps.high < 0 ? steps.high : 0;
    }
    noslip_move(inputs, way, s, count);
    if (!steps.any) {
        noslip_move_ground(ground, effects, s, contacts);
    }
    return steps.any;
}

/* Goes towards the end of `way` as little as needed, and returns 1; if nothing on it is within friction and limits, goes to the
 * end and returns 0. `ground` is that of the end. `effects` as in noslip_go_along. */
NOSLIP_APART int noslip_go_towards(double *inputs, const double *way, double *ground,
                    const double *by_inputs, double height, const double *limits,
                    int contacts, int count, double *effects)
{
    noslip_steps steps;
    double s;
    int any;
    noslip_effects(way, by_inputs, height, contacts, count, effects);
    noslip_move(inputs, way, 1, count);
    noslip_move_ground(ground, effects, 1, contacts);
    steps = noslip_steps_within(inputs, way, ground, effects, limits, contacts, count);
    s = steps.low > -1 ? steps.low : -1;
    any = steps.any && s <= steps.high && s <= 0;
    if (any) {
        noslip_move(inputs, way, s, count);
    }
    return any;
}

/* Brings finite inputs within their limits (from noslip_limit). Returns 1 if all are finite. */
static inline int noslip_cut(double *inputs, const double *limits, int count)
{
    int i, finite = 1;
    for (i = 0; i < count; i++) {
        if (!noslip_is_finite(inputs[i])) {
            finite = 0;
        } else if (!noslip_within(inputs[i], limits[i])) {
            inputs[i] = inputs[i] > 0 ? limits[i] : -limits[i];
        }
    }
    return finite;
}

/*
 * Changes two inputs so that each contact stays within friction and each input within its limit (from noslip_limit). First along
 * `slope`, the derivative of the inputs by the virtual input of the speed (NULL: there is none), as little as needed. If that is
 * not enough, from the best point there towards coasting, as little as needed; if even that is not enough, coasting, within the
 * limits. `ground` as in noslip_holds for each contact; it is overwritten. `by_inputs` as in noslip_effects. `work` is memory for
 * 3 numbers for each contact. Returns 1 if the new inputs are finite; whether they keep each contact within friction is to be checked
 * by noslip_holds.
 */
NOSLIP_APART int noslip_keep_grip(double *inputs, const double *slope, double *ground,
                    const double *by_inputs, const noslip_grip *grip,
                    const double *limits, int contacts, double *work)
{
    const noslip_grip below = noslip_grip_below(grip);
    noslip_write_loads(ground, &below, contacts);
    if (slope == NULL || !noslip_go_along(inputs, slope, ground, by_inputs, below.height, limits, contacts, 2, work)) {
        double way[2];
        noslip_way_to_coasting(ground, by_inputs, contacts, way);
        (void)noslip_go_towards(inputs, way, ground, by_inputs, below.height, limits, contacts, 2, work);
    }
    return noslip_cut(inputs, limits, 2);
}

/* -- float: generated from noslip_grip.inc by guarantees/headers.py ---------------------------------------------------- */

/* What a controller believes of friction; all zero: no limit of friction. */
typedef struct noslip_friction_f {
    float mu;           /* coefficient of friction between wheels and floor */
    float margin;       /* part of mu that is kept in reserve, from 0 to less than 1 */
    float share;        /* part of the weight that rests on the contacts of the model, at most 1; 0: all of it */
    float height;       /* m: of the centre of mass above the floor, which moves load to the outer wheels of an axle */
} noslip_friction_f;

/* The same for a step: mu load = weight * mass + height * shift; see noslip_holds. */
typedef struct noslip_grip_f {
    float weight;       /* m/s^2 */
    float height;       /* m */
} noslip_grip_f;

/* Returns 1 if the numbers are in their ranges and mu is not zero; `wide` is 0 if an axle cannot carry a height. */
static inline int noslip_friction_ok_f(const noslip_friction_f *friction, int wide)
{
    return noslip_is_positive_f(friction->mu) && friction->margin >= 0 && friction->margin < 1 &&
        friction->share >= 0 && friction->share <= 1 && noslip_is_finite_f(friction->height) &&
        friction->height >= 0 && (wide || !(friction->height > 0));
}

/* Returns the limit of friction for a step. */
static inline noslip_grip_f noslip_grip_of_f(const noslip_friction_f *friction)
{
    const float mu = friction->mu * (1 - friction->margin);
    noslip_grip_f grip;
    grip.weight = mu * (friction->share > 0 ? friction->share : 1) * (float)NOSLIP_GRAVITY;
    grip.height = mu * friction->height;
    return grip;
}

/*
 * Returns 1 if the force at a contact is within friction, else 0; 0 for NaN. `ground` is the force along and across (N), the shift of
 * the load by the height (N/m), and the mass (kg). Of forces and loads above 1e-15 N: where it returns 1, the force is at most
 * 1 + FLT_EPSILON times the computed mu load. A difference has the right sign also when rounded, so that x = most^2 - along^2, rounded,
 * is at least across^2, rounded; each of x and the three squares is off by at most half of FLT_EPSILON.
 */
NOSLIP_HOT int noslip_holds_f(const float *ground, const noslip_grip_f *grip)
{
    const float most = grip->weight * ground[3] + grip->height * ground[2];
    return most * noslip_abs_f(most) - ground[0] * ground[0] - ground[1] * ground[1] >= 0;            /* NaN if they overflow */
}

/* Numbers s from low to high; none if low > high. `any` is 0 if some condition holds for no s: then low and high are the s
 * nearest to holding. */
typedef struct noslip_steps_f {
    float low, high;
    int any;
} noslip_steps_f;

/* Keeps the s from `low` to `high`. */
static inline void noslip_narrow_f(noslip_steps_f *steps, float low, float high)
{
    steps->low = low > steps->low ? low : steps->low;
    steps->high = high < steps->high ? high : steps->high;
}

/*
 * Keeps the s with |F + s D| <= N + s M, a convex cone: `at` is (F along, F across, N), `way` is (D along, D across, M). If there
 * are none, keeps the s at which |F + s D|^2 - (N + s M)^2 is smallest.
 */
NOSLIP_APART void noslip_within_cone_f(noslip_steps_f *steps, const float *at, const float *way)
{
    const float a = way[0] * way[0] + way[1] * way[1] - way[2] * way[2];       /* a s^2 + 2 b s + c <= 0 */
    const float b = at[0] * way[0] + at[1] * way[1] - at[2] * way[2];
    const float c = at[0] * at[0] + at[1] * at[1] - at[2] * at[2];
    const float square = b * b - a * c, root = noslip_sqrt_f(square > 0 ? square : 0);
    const float larger = b > 0 ? -(b + root) : root - b;       /* the root of larger size, times a */
    if (a > 0) {
        const float middle = -b / a;
        if (square >= 0 && at[2] + middle * way[2] >= 0) {
            const float one = larger / a, other = noslip_abs_f(larger) > 0 ? c / larger : 0;
            noslip_narrow_f(steps, one < other ? one : other, one < other ? other : one);
        } else {
            steps->any = 0;
            noslip_narrow_f(steps, middle, middle);
        }
    } else if (noslip_abs_f(larger) > 0) {            /* the load grows faster than the force: a half-line; as fast: or nothing */
        const float other = c / larger, one = a < 0 ? larger / a : other;
        const float end = (way[2] > 0) == (one > other) ? one : other, load = at[2] + end * way[2];
        if (!(load >= 0 && noslip_is_finite_f(load))) {
            steps->any = 0;
        } else if (way[2] > 0) {
            noslip_narrow_f(steps, end, FLT_MAX);
        } else {
            noslip_narrow_f(steps, -FLT_MAX, end);
        }
    } else if (!(c <= 0 && at[2] >= 0)) {
        steps->any = 0;
    }
}

/* Returns the limit of friction less 1024 roundings, so that rounding does not exceed it. */
static inline noslip_grip_f noslip_grip_below_f(const noslip_grip_f *grip)
{
    noslip_grip_f below;
    below.weight = grip->weight * (1 - 1024 * FLT_EPSILON);
    below.height = grip->height * (1 - 1024 * FLT_EPSILON);
    return below;
}

/* Replaces the shift of the load in `ground`, as in noslip_holds for each contact, by mu load (N): (F along, F across, N, mass). */
static inline void noslip_write_loads_f(float *ground, const noslip_grip_f *grip, int contacts)
{
    int k;
    for (k = 0; k < contacts; k++) {
        ground[4 * k + 2] = grip->weight * ground[4 * k + 3] + grip->height * ground[4 * k + 2];
    }
}

/* Returns the sum of by[i] way[i] over `count` inputs, two or more. */
NOSLIP_HOT float noslip_effect_f(const float *by, const float *way, int count)
{
    float sum = by[0] * way[0] + by[1] * way[1];
    int i;
    for (i = 2; i < count; i++) {
        sum += by[i] * way[i];
    }
    return sum;
}

/* Computes what `way` adds at each contact to (F along, F across, N). `by_inputs` has for each contact the derivatives of the force
 * along and across and of the shift of the load by each of `count` inputs; `height` is that of noslip_grip_below. */
NOSLIP_APART void noslip_effects_f(const float *way, const float *by_inputs,
                       float height, int contacts, int count, float *effects)
{
    int k;
    for (k = 0; k < contacts; k++) {
        const float *by = by_inputs + 3 * k * count;
        effects[3 * k] = noslip_effect_f(by, way, count);
        effects[3 * k + 1] = noslip_effect_f(by + count, way, count);
        effects[3 * k + 2] = height * noslip_effect_f(by + 2 * count, way, count);
    }
}

/*
 * Returns the s with which the inputs + s `way` keep each contact within friction and each of `count` inputs within its limit.
 * `ground` is that of noslip_write_loads, `effects` that of noslip_effects. Parts of `way` below 1e-5 of the largest count as zero
 * for the limits.
 */
NOSLIP_APART noslip_steps_f noslip_steps_within_f(const float *inputs, const float *way,
                                      const float *ground, const float *effects,
                                      const float *limits, int contacts, int count)
{
    noslip_steps_f steps;
    float largest = 0;
    int i, k;
    steps.low = -FLT_MAX;
    steps.high = FLT_MAX;
    steps.any = 1;
    for (k = 0; k < contacts; k++) {
        noslip_within_cone_f(&steps, ground + 4 * k, effects + 3 * k);
    }
    for (i = 0; i < count; i++) {
        largest = noslip_abs_f(way[i]) > largest ? noslip_abs_f(way[i]) : largest;
    }
    for (i = 0; i < count; i++) {
        if (noslip_abs_f(way[i]) * 100000 > largest) {
            const float middle = -inputs[i] / way[i], half = limits[i] / noslip_abs_f(way[i]);
            noslip_narrow_f(&steps, middle - half, middle + half);
        } else if (!noslip_within_f(inputs[i], limits[i])) {
            steps.any = 0;
        }
    }
    return steps;
}

/* Adds s `way` to the inputs. */
static inline void noslip_move_f(float *inputs, const float *way, float s, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        inputs[i] += s * way[i];
    }
}

/* Adds s `effects` to `ground`. */
NOSLIP_APART void noslip_move_ground_f(float *ground, const float *effects, float s, int contacts)
{
    int k;
    for (k = 0; k < contacts; k++) {
        ground[4 * k] += s * effects[3 * k];
        ground[4 * k + 1] += s * effects[3 * k + 1];
        ground[4 * k + 2] += s * effects[3 * k + 2];
    }
}

/* Returns 1 / mass; 0 if there is none. */
static inline float noslip_per_mass_f(float mass)
{
    return noslip_abs_f(mass) > 0 ? 1 / mass : 0;
}

/*
 * Computes the way from two inputs to coasting, where the sum of (F / mass)^2 over the contacts is smallest: one step of
 * least squares. If an input, or a combination of both, has no effect on the forces, goes down the gradient only.
 */
NOSLIP_APART void noslip_way_to_coasting_f(const float *ground, const float *by_inputs, int contacts,
                                float *way)
{
    float xx = 0, xy = 0, yy = 0, x = 0, y = 0, determinant;
    int i, k;
    for (k = 0; k < contacts; k++) {
        const float light = noslip_per_mass_f(ground[4 * k + 3]);
        for (i = 0; i < 2; i++) {
            const float *by = by_inputs + 6 * k + 2 * i;
            const float one = by[0] * light, other = by[1] * light, force = ground[4 * k + i] * light;
            xx += one * one;
            xy += one * other;
            yy += other * other;
            x += one * force;
            y += other * force;
        }
    }
    determinant = xx * yy - xy * xy;
    if (determinant > (float)1e-5 * xx * yy) {
        way[0] = (xy * y - yy * x) / determinant;
        way[1] = (xy * x - xx * y) / determinant;
    } else {
        const float bend = xx * x * x + 2 * xy * x * y + yy * y * y, slope = x * x + y * y;
        const float length = bend > 0 ? slope / bend : 0;
        way[0] = -length * x;
        way[1] = -length * y;
    }
}

/* Goes along `way` as little as needed, and returns 1; if nothing there is within friction and limits, goes as near to it as it
 * gets, changes `ground` accordingly, and returns 0. `effects` is memory for 3 numbers for each contact. */
NOSLIP_APART int noslip_go_along_f(float *inputs, const float *way, float *ground,
                 const float *by_inputs, float height, const float *limits,
                 int contacts, int count, float *effects)
{
    noslip_steps_f steps;
    float s;
    noslip_effects_f(way, by_inputs, height, contacts, count, effects);
    steps = noslip_steps_within_f(inputs, way, ground, effects, limits, contacts, count);
    if (steps.low > steps.high) { /* apart from each other: in the middle between them */
        steps.any = 0;
        s = steps.low / 2 + steps.high / 2;
    } else {
        s = steps.low > 0 ? steps.low : steps.high < 0 ? steps.high : 0;
    }
    noslip_move_f(inputs, way, s, count);
    if (!steps.any) {
        noslip_move_ground_f(ground, effects, s, contacts);
    }
    return steps.any;
}

/* Goes towards the end of `way` as little as needed, and returns 1; if nothing on it is within friction and limits, goes to the
 * end and returns 0. `ground` is that of the end. `effects` as in noslip_go_along. */
NOSLIP_APART int noslip_go_towards_f(float *inputs, const float *way, float *ground,
                   const float *by_inputs, float height, const float *limits,
                   int contacts, int count, float *effects)
{
    noslip_steps_f steps;
    float s;
    int any;
    noslip_effects_f(way, by_inputs, height, contacts, count, effects);
    noslip_move_f(inputs, way, 1, count);
    noslip_move_ground_f(ground, effects, 1, contacts);
    steps = noslip_steps_within_f(inputs, way, ground, effects, limits, contacts, count);
    s = steps.low > -1 ? steps.low : -1;
    any = steps.any && s <= steps.high && s <= 0;
    if (any) {
        noslip_move_f(inputs, way, s, count);
    }
    return any;
}

/* Brings finite inputs within their limits (from noslip_limit). Returns 1 if all are finite. */
static inline int noslip_cut_f(float *inputs, const float *limits, int count)
{
    int i, finite = 1;
    for (i = 0; i < count; i++) {
        if (!noslip_is_finite_f(inputs[i])) {
            finite = 0;
        } else if (!noslip_within_f(inputs[i], limits[i])) {
            inputs[i] = inputs[i] > 0 ? limits[i] : -limits[i];
        }
    }
    return finite;
}

/*
 * Changes two inputs so that each contact stays within friction and each input within its limit (from noslip_limit). First along
 * `slope`, the derivative of the inputs by the virtual input of the speed (NULL: there is none), as little as needed. If that is
 * not enough, from the best point there towards coasting, as little as needed; if even that is not enough, coasting, within the
 * limits. `ground` as in noslip_holds for each contact; it is overwritten. `by_inputs` as in noslip_effects. `work` is memory for
 * 3 numbers for each contact. Returns 1 if the new inputs are finite; whether they keep each contact within friction is to be checked
 * by noslip_holds.
 */
NOSLIP_APART int noslip_keep_grip_f(float *inputs, const float *slope, float *ground,
                   const float *by_inputs, const noslip_grip_f *grip,
                   const float *limits, int contacts, float *work)
{
    const noslip_grip_f below = noslip_grip_below_f(grip);
    noslip_write_loads_f(ground, &below, contacts);
    if (slope == NULL || !noslip_go_along_f(inputs, slope, ground, by_inputs, below.height, limits, contacts, 2, work)) {
        float way[2];
        noslip_way_to_coasting_f(ground, by_inputs, contacts, way);
        (void)noslip_go_towards_f(inputs, way, ground, by_inputs, below.height, limits, contacts, 2, work);
    }
    return noslip_cut_f(inputs, limits, 2);
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
