/*
 * noslip_course.h - a smooth curve for laws with a dynamic extension: a point of it with six derivatives.
 *
 * An output of relative degree k follows a reference without an error only if k - 1 of its derivatives are continuous. The
 * middle of a car's rear axle has k = 4: it cannot follow lines and arcs, where the steering angle would have to jump, nor
 * clothoids, where its rate would. A course is given by its curvature where parts begin and end; before the first and after the
 * last it stays. With a rounding the parts are lines, arcs and clothoids, and the rate of the curvature changes smoothly over that
 * length where they meet; without, the curvature changes smoothly over the whole of each part. The beginning is not rounded: if a
 * vehicle may be behind it, let a course with a rounding begin with a line or an arc, else the rate jumps there.
 *
 *     static const float lengths[] = {2, 4, 5}, curvatures[] = {0, 0, 0.2f, 0.2f};
 *     static noslip_stretch_f stretches[NOSLIP_COURSE_ROOM(3)];
 *     const noslip_course_options_f options = {.lengths = lengths, .curvatures = curvatures, .count = 3, .rounding = 0.2f};
 *     status = noslip_course_init_f(&course, stretches, NOSLIP_COURSE_ROOM(3), &options);
 *
 * At each call, with the position of the output and the length along the course of the call before:
 *
 *     status = noslip_course_nearest_f(&course, x, y, &length);      or length += speed * dt: in time
 *     status = noslip_course_at_f(&course, length, speed, &point);
 *     reference.x_l = point.x[0];                                    reference.x_l_rate = point.x[1]; and so on
 *
 * A call computes two sines and cosines on lines and arcs, 9 on clothoids, 25 elsewhere, and 8 more for each radian that a stretch
 * turns; noslip_course_nearest as many for each of its steps, two or three if the vehicle goes on as before.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_COURSE_H
#define NOSLIP_COURSE_H

#include "noslip_controller.h"

#define NOSLIP_COURSE_ORDER 6                       /* of the highest derivative */
#define NOSLIP_COURSE_TERMS 10                      /* of the polynomial of a curvature */
#define NOSLIP_COURSE_TURN 16                       /* rad: that a stretch may turn */
#define NOSLIP_COURSE_STEPS 20                      /* of Newton's method, at most */
#define NOSLIP_COURSE_FLATTEST 0.1                  /* how near a point may be to the centre of curvature, in radii */
#define NOSLIP_COURSE_ROOM(count) (2 * (count) + 1) /* stretches for so many parts */

/* -- double: generated from noslip_course.inc by guarantees/headers.py ------------------------------------------------- */

/* What a course is made of. Read by init only. */
typedef struct noslip_course_options {
    double x, y;                   /* m: where it begins */
    double heading;                /* rad: its direction there */
    const double *lengths;         /* m: of its parts, each positive */
    const double *curvatures;      /* 1/m, positive turns left: where each part begins, and where the last ends */
    int count;                     /* of the lengths; there is one curvature more */
    double rounding;               /* m, at most the shortest of the lengths; 0: the curvature changes over each part */
} noslip_course_options;

/* A stretch over which the curvature is a polynomial in the part of its length. */
typedef struct noslip_stretch {
    double begin;                                  /* m: along the course */
    double length;                                 /* m */
    double x, y, heading;                          /* m, rad: where it begins */
    double curvature[NOSLIP_COURSE_TERMS];         /* 1/m: coefficients by power */
    int terms;                                     /* how many of them there are */
} noslip_stretch;

/* A course: initialized by init, owned by the caller, who does not write to it. */
typedef struct noslip_course {
    const noslip_stretch *stretches;
    int count;
    int ready;
} noslip_course;

/* A point of a course and its derivatives by time up to the sixth, m, m/s and so on. */
typedef struct noslip_course_point {
    double x[NOSLIP_COURSE_ORDER + 1];
    double y[NOSLIP_COURSE_ORDER + 1];
} noslip_course_point;

/*
 * Returns the derivative of an order of the curvature by the part of the length, 1/m; of order -1: its integral. Before the
 * beginning of the stretch the curvature is that of the beginning.
 */
static inline double noslip_course_curvature(const noslip_stretch *stretch, double part,
                           int order)
{
    double sum = 0, factor;
    int power, k;
    for (power = part < 0 ? 0 : stretch->terms - 1; power >= 0 && power >= order; power--) {
        factor = order < 0 ? 1 / (double)(power + 1) : (double)1;
        for (k = 0; k < order; k++) {
            factor *= (double)(power - k);
        }
        sum = sum * part + factor * stretch->curvature[power];
    }
    return order < 0 ? sum * part : sum;
}

/* Returns the direction (rad) `along` m after the beginning of a stretch. */
static inline double noslip_course_direction(const noslip_stretch *stretch, double along)
{
    return stretch->heading + stretch->length * noslip_course_curvature(stretch, along / stretch->length, -1);
}

/*
 * Returns a bound of the magnitude of the curvature of a stretch with two terms or more, up to a part of its length: those at both
 * ends, and in between that of lines in the directions of the curvature there, as before rounding.
 */
static inline double noslip_course_bend(const noslip_stretch *stretch, double part)
{
    const double first = noslip_abs(stretch->curvature[0]);
    const double joint = noslip_abs(stretch->curvature[0] + stretch->curvature[1] / 2);
    const double last = noslip_abs(noslip_course_curvature(stretch, part, 0));
    const double larger = first > last ? first : last;
    return joint > larger ? joint : larger;
}

/*
 * Computes the position `along` m after the beginning of a stretch, m. On lines and arcs in closed form; elsewhere by the
 * quadrature of Gauss and Legendre with 8 points over each radian of the turn, of which init allows NOSLIP_COURSE_TURN, and over
 * thirds where the curvature is not linear.
 */
static inline void noslip_course_place(const noslip_stretch *stretch, double along, double *x,
                double *y)
{
    static const double place[4] = {(double)0.18343464249564981, (double)0.525532409916329,
                                         (double)0.7966664774136267, (double)0.9602898564975363};
    static const double weight[4] = {(double)0.362683783378362, (double)0.31370664587788727,
                                          (double)0.22238103445337448, (double)0.10122853629037626};
    double sine, cosine, half, ahead = 0, beside = 0;
    int pieces, k, node;
    if (stretch->terms == 1 || along < 0) {
        half = along * stretch->curvature[0] / 2;
        noslip_sincos(stretch->heading + half, &sine, &cosine);
        half = along * noslip_sinc(half);
        *x = stretch->x + half * cosine;
        *y = stretch->y + half * sine;
        return;
    }
    half = along * noslip_course_bend(stretch, along / stretch->length);
    pieces = 1;
    if (stretch->terms > 2) {
        pieces = 3;
    }
    if (noslip_is_finite(half) && half >= 0 && half < NOSLIP_COURSE_TURN) {
        pieces += (int)half;
    } else {
        pieces += NOSLIP_COURSE_TURN;
    }
    half = along / (double)(2 * pieces);
    for (k = 0; k < pieces; k++) {
        for (node = 0; node < 8; node++) {
            const double off = node < 4 ? place[node] : -place[node - 4];
            noslip_sincos(noslip_course_direction(stretch, ((double)(2 * k + 1) + off) * half),
                                       &sine, &cosine);
            ahead += weight[node & 3] * cosine;
            beside += weight[node & 3] * sine;
        }
    }
    *x = stretch->x + half * ahead;
    *y = stretch->y + half * beside;
}

/* Returns the stretch at a length along the course; before its beginning the first. */
static inline const noslip_stretch *noslip_course_stretch(const noslip_course *self,
                                             double length)
{
    int k = self->count - 1;
    while (k > 0 && length < self->stretches[k].begin) {
        k--;
    }
    return &self->stretches[k];
}

/* Adds a stretch whose curvature has these coefficients. Returns 1, or 0 if it is too long or turns too far. */
static inline int noslip_course_add(noslip_stretch *stretches, int *count, double length,
                  const double *curvature, int terms)
{
    noslip_stretch *own = &stretches[*count];
    double turn = 0;
    int k;
    own->length = length;
    own->terms = terms;
    for (k = 0; k < terms; k++) {
        own->curvature[k] = curvature[k];
    }
    if (*count > 0) {
        const noslip_stretch *last = &stretches[*count - 1];
        own->begin = last->begin + last->length;
        own->heading = noslip_course_direction(last, last->length);
        if (!noslip_angle_ok(own->heading)) {
            return 0;
        }
        noslip_course_place(last, last->length, &own->x, &own->y);
    }
    *count += 1;
    if (terms > 1) {
        turn = length * noslip_course_bend(own, 1);
    }
    return noslip_sum_finite(own->begin, own->x, own->y) && turn < NOSLIP_COURSE_TURN;
}

/* Adds a part of a course without rounding: four derivatives of its curvature are continuous. Returns as the last. */
static inline int noslip_course_blend(noslip_stretch *stretches, int *count,
                         const noslip_course_options *options, int part)
{
    static const double smooth[9] = {0, 0, 0, 0, 126, -420, 540, -315, 70};
    const double change = options->curvatures[part + 1] - options->curvatures[part];
    const int terms = change < 0 || change > 0 ? NOSLIP_COURSE_TERMS : 1;
    double curvature[NOSLIP_COURSE_TERMS];
    int k;
    curvature[0] = options->curvatures[part];
    for (k = 0; k < 9; k++) {
        curvature[k + 1] = change * smooth[k];
    }
    return noslip_course_add(stretches, count, options->lengths[part], curvature, terms);
}

/* Returns the rate of the curvature of a part of a course with rounding, 1/m^2; 0 after the last. */
static inline double noslip_course_rate(const noslip_course_options *options, int part)
{
    return part < options->count ? (options->curvatures[part + 1] - options->curvatures[part]) / options->lengths[part]
                                 : (double)0;
}

/* Adds a part of a course with rounding: a line, arc or clothoid, and the way from there to the next. */
static inline int noslip_course_round(noslip_stretch *stretches, int *count,
                         const noslip_course_options *options, int part)
{
    static const double rise[7] = {0, 0, 0, 7, -14, 10, (double)-2.5};
    const double rate = noslip_course_rate(options, part), half = options->rounding / 2;
    const double change = (noslip_course_rate(options, part + 1) - rate) * options->rounding;
    const double begin = part > 0 ? half : (double)0, straight = options->lengths[part] - begin - half;
    const int terms = rate < 0 || rate > 0 ? 2 : 1;
    double curvature[NOSLIP_COURSE_TERMS];
    int k;
    if (straight > 0) {
        curvature[0] = options->curvatures[part] + rate * begin;
        curvature[1] = rate * straight;
        if (!noslip_course_add(stretches, count, straight, curvature, terms)) {
            return 0;
        }
    }
    curvature[0] = options->curvatures[part + 1] - rate * half;
    curvature[1] = rate * options->rounding;
    for (k = 0; k < 7; k++) {
        curvature[k + 2] = change * rise[k];
    }
    return noslip_course_add(stretches, count, options->rounding, curvature, NOSLIP_COURSE_TERMS - 1);
}

/* Returns 1 if each number of the options is one that a course can have. */
static inline int noslip_course_options_ok(const noslip_course_options *options)
{
    int good = noslip_is_finite(options->x) && noslip_is_finite(options->y), k;
    good = good && noslip_angle_ok(options->heading) && noslip_is_finite(options->rounding);
    good = good && options->rounding >= 0 && noslip_is_finite(options->curvatures[0]);
    for (k = 0; k < options->count && good; k++) {
        good = noslip_is_positive(options->lengths[k]) && options->lengths[k] >= options->rounding &&
               noslip_is_finite(options->curvatures[k + 1]);
    }
    return good;
}

/*
 * Initializes. `stretches` is the caller's memory for `room` of them, NOSLIP_COURSE_ROOM(count), which must live as long as the
 * course; the options and their arrays need not. Returns NOSLIP_NULL, NOSLIP_FULL if the room is too small, NOSLIP_BAD_PARAMETER
 * for numbers that a course cannot have: see the options. A part whose curvature is not constant may turn by less than
 * NOSLIP_COURSE_TURN rad.
 */
NOSLIP_NODISCARD static inline int noslip_course_init(noslip_course *self,
                                         noslip_stretch *stretches, int room,
                                         const noslip_course_options *options)
{
    int count = 0, good, k;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (stretches == NULL || options == NULL || options->curvatures == NULL || options->lengths == NULL) {
        return NOSLIP_NULL;
    }
    if (options->count < 0) {
        return NOSLIP_BAD_PARAMETER;
    }
    if (room < 1 || options->count > (room - 1) / 2) {
        return NOSLIP_FULL;
    }
    good = noslip_course_options_ok(options);
    stretches[0].begin = 0;
    stretches[0].x = options->x;
    stretches[0].y = options->y;
    stretches[0].heading = options->heading;
    for (k = 0; k < options->count && good; k++) {
        good = options->rounding > 0 ? noslip_course_round(stretches, &count, options, k)
                                     : noslip_course_blend(stretches, &count, options, k);
    }
    if (!good || !noslip_course_add(stretches, &count, 1, &options->curvatures[options->count], 1)) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->stretches = stretches;
    self->count = count;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/*
 * Writes the point `length` m along the course, and its derivatives by time if it moves with a constant `speed` (m/s): the
 * reference of an output whose first two rows are a position. Before its beginning the first curvature stays, after its end the
 * last.
 * On an error nothing is written: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_RANGE where the direction is too large.
 */
NOSLIP_NODISCARD static inline int noslip_course_at(const noslip_course *self, double length,
                                  double speed, noslip_course_point *point)
{
    const noslip_stretch *stretch;
    noslip_course_point own;
    double rate[NOSLIP_COURSE_ORDER - 1], along, direction, factor, sine, cosine, size = 0;
    int n, k, choose;
    if (self == NULL || point == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_is_finite(length) || !noslip_is_finite(speed)) {
        return NOSLIP_NONFINITE;
    }
    stretch = noslip_course_stretch(self, length);
    along = length - stretch->begin;
    direction = noslip_course_direction(stretch, along);
    if (!noslip_angle_ok(direction)) {
        return NOSLIP_RANGE;
    }
    factor = speed;
    for (n = 0; n < NOSLIP_COURSE_ORDER - 1; n++) {
        rate[n] = factor * noslip_course_curvature(stretch, along / stretch->length, n);
        factor *= speed / stretch->length;
    }
    noslip_sincos(direction, &sine, &cosine);
    own.x[1] = speed * cosine;
    own.y[1] = speed * sine;
    for (n = 0; n < NOSLIP_COURSE_ORDER - 1; n++) { /* the derivative of a vector that turns at the rate rate[0] */
        choose = 1;
        own.x[n + 2] = 0;
        own.y[n + 2] = 0;
        for (k = 0; k <= n; k++) {
            own.x[n + 2] -= (double)choose * rate[k] * own.y[n + 1 - k];
            own.y[n + 2] += (double)choose * rate[k] * own.x[n + 1 - k];
            choose = choose * (n - k) / (k + 1);
        }
    }
    noslip_course_place(stretch, along, &own.x[0], &own.y[0]);
    for (n = 0; n <= NOSLIP_COURSE_ORDER; n++) {
        size += noslip_abs(own.x[n]) + noslip_abs(own.y[n]);
    }
    if (!noslip_is_finite(size)) {
        return NOSLIP_NONFINITE;
    }
    for (n = 0; n <= NOSLIP_COURSE_ORDER; n++) {
        point->x[n] = own.x[n];
        point->y[n] = own.y[n];
    }
    return NOSLIP_OK;
}

/*
 * Searches the length along the course, m, at which it is nearest to (x, y), m, by Newton's method from `length`, that of the call
 * before: a vehicle then follows the course from wherever it is beside it. On an error nothing changes: NOSLIP_NULL,
 * NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_RANGE, NOSLIP_SINGULAR if the point is as far as the centre of curvature, or too far
 * ahead for NOSLIP_COURSE_STEPS steps.
 */
NOSLIP_NODISCARD static inline int noslip_course_nearest(const noslip_course *self, double x,
                                       double y, double *length)
{
    double found, along, direction, sine, cosine, place[2], ahead, slope, step;
    int k;
    if (self == NULL || length == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    found = *length;
    for (k = 0; k < NOSLIP_COURSE_STEPS; k++) {
        const noslip_stretch *stretch;
        if (!noslip_sum_finite(x, y, found)) {
            return NOSLIP_NONFINITE;
        }
        stretch = noslip_course_stretch(self, found);
        along = found - stretch->begin;
        direction = noslip_course_direction(stretch, along);
        if (!noslip_angle_ok(direction)) {
            return NOSLIP_RANGE;
        }
        noslip_sincos(direction, &sine, &cosine);
        noslip_course_place(stretch, along, &place[0], &place[1]);
        ahead = (x - place[0]) * cosine + (y - place[1]) * sine;
        slope = 1 - noslip_course_curvature(stretch, along / stretch->length, 0) *
                    ((y - place[1]) * cosine - (x - place[0]) * sine);
        if (!(slope > (double)NOSLIP_COURSE_FLATTEST)) {
            return NOSLIP_SINGULAR;
        }
        step = ahead / slope;
        found += step;
        if (step * step <= DBL_EPSILON) {    /* the next one is about its square */
            if (!noslip_is_finite(found)) {
                return NOSLIP_NONFINITE;
            }
            *length = found;
            return NOSLIP_OK;
        }
    }
    return NOSLIP_SINGULAR;
}

/* -- float: generated from noslip_course.inc by guarantees/headers.py -------------------------------------------------- */

/* What a course is made of. Read by init only. */
typedef struct noslip_course_options_f {
    float x, y;                    /* m: where it begins */
    float heading;                 /* rad: its direction there */
    const float *lengths;          /* m: of its parts, each positive */
    const float *curvatures;       /* 1/m, positive turns left: where each part begins, and where the last ends */
    int count;                     /* of the lengths; there is one curvature more */
    float rounding;                /* m, at most the shortest of the lengths; 0: the curvature changes over each part */
} noslip_course_options_f;

/* A stretch over which the curvature is a polynomial in the part of its length. */
typedef struct noslip_stretch_f {
    float begin;                                   /* m: along the course */
    float length;                                  /* m */
    float x, y, heading;                           /* m, rad: where it begins */
    float curvature[NOSLIP_COURSE_TERMS];          /* 1/m: coefficients by power */
    int terms;                                     /* how many of them there are */
} noslip_stretch_f;

/* A course: initialized by init, owned by the caller, who does not write to it. */
typedef struct noslip_course_f {
    const noslip_stretch_f *stretches;
    int count;
    int ready;
} noslip_course_f;

/* A point of a course and its derivatives by time up to the sixth, m, m/s and so on. */
typedef struct noslip_course_point_f {
    float x[NOSLIP_COURSE_ORDER + 1];
    float y[NOSLIP_COURSE_ORDER + 1];
} noslip_course_point_f;

/*
 * Returns the derivative of an order of the curvature by the part of the length, 1/m; of order -1: its integral. Before the
 * beginning of the stretch the curvature is that of the beginning.
 */
static inline float noslip_course_curvature_f(const noslip_stretch_f *stretch, float part,
                             int order)
{
    float sum = 0, factor;
    int power, k;
    for (power = part < 0 ? 0 : stretch->terms - 1; power >= 0 && power >= order; power--) {
        factor = order < 0 ? 1 / (float)(power + 1) : (float)1;
        for (k = 0; k < order; k++) {
            factor *= (float)(power - k);
        }
        sum = sum * part + factor * stretch->curvature[power];
    }
    return order < 0 ? sum * part : sum;
}

/* Returns the direction (rad) `along` m after the beginning of a stretch. */
static inline float noslip_course_direction_f(const noslip_stretch_f *stretch, float along)
{
    return stretch->heading + stretch->length * noslip_course_curvature_f(stretch, along / stretch->length, -1);
}

/*
 * Returns a bound of the magnitude of the curvature of a stretch with two terms or more, up to a part of its length: those at both
 * ends, and in between that of lines in the directions of the curvature there, as before rounding.
 */
static inline float noslip_course_bend_f(const noslip_stretch_f *stretch, float part)
{
    const float first = noslip_abs_f(stretch->curvature[0]);
    const float joint = noslip_abs_f(stretch->curvature[0] + stretch->curvature[1] / 2);
    const float last = noslip_abs_f(noslip_course_curvature_f(stretch, part, 0));
    const float larger = first > last ? first : last;
    return joint > larger ? joint : larger;
}

/*
 * Computes the position `along` m after the beginning of a stretch, m. On lines and arcs in closed form; elsewhere by the
 * quadrature of Gauss and Legendre with 8 points over each radian of the turn, of which init allows NOSLIP_COURSE_TURN, and over
 * thirds where the curvature is not linear.
 */
static inline void noslip_course_place_f(const noslip_stretch_f *stretch, float along, float *x,
                  float *y)
{
    static const float place[4] = {(float)0.18343464249564981, (float)0.525532409916329,
                                         (float)0.7966664774136267, (float)0.9602898564975363};
    static const float weight[4] = {(float)0.362683783378362, (float)0.31370664587788727,
                                          (float)0.22238103445337448, (float)0.10122853629037626};
    float sine, cosine, half, ahead = 0, beside = 0;
    int pieces, k, node;
    if (stretch->terms == 1 || along < 0) {
        half = along * stretch->curvature[0] / 2;
        noslip_sincos_f(stretch->heading + half, &sine, &cosine);
        half = along * noslip_sinc_f(half);
        *x = stretch->x + half * cosine;
        *y = stretch->y + half * sine;
        return;
    }
    half = along * noslip_course_bend_f(stretch, along / stretch->length);
    pieces = 1;
    if (stretch->terms > 2) {
        pieces = 3;
    }
    if (noslip_is_finite_f(half) && half >= 0 && half < NOSLIP_COURSE_TURN) {
        pieces += (int)half;
    } else {
        pieces += NOSLIP_COURSE_TURN;
    }
    half = along / (float)(2 * pieces);
    for (k = 0; k < pieces; k++) {
        for (node = 0; node < 8; node++) {
            const float off = node < 4 ? place[node] : -place[node - 4];
            noslip_sincos_f(noslip_course_direction_f(stretch, ((float)(2 * k + 1) + off) * half),
                                       &sine, &cosine);
            ahead += weight[node & 3] * cosine;
            beside += weight[node & 3] * sine;
        }
    }
    *x = stretch->x + half * ahead;
    *y = stretch->y + half * beside;
}

/* Returns the stretch at a length along the course; before its beginning the first. */
static inline const noslip_stretch_f *noslip_course_stretch_f(const noslip_course_f *self,
                                                   float length)
{
    int k = self->count - 1;
    while (k > 0 && length < self->stretches[k].begin) {
        k--;
    }
    return &self->stretches[k];
}

/* Adds a stretch whose curvature has these coefficients. Returns 1, or 0 if it is too long or turns too far. */
static inline int noslip_course_add_f(noslip_stretch_f *stretches, int *count, float length,
                     const float *curvature, int terms)
{
    noslip_stretch_f *own = &stretches[*count];
    float turn = 0;
    int k;
    own->length = length;
    own->terms = terms;
    for (k = 0; k < terms; k++) {
        own->curvature[k] = curvature[k];
    }
    if (*count > 0) {
        const noslip_stretch_f *last = &stretches[*count - 1];
        own->begin = last->begin + last->length;
        own->heading = noslip_course_direction_f(last, last->length);
        if (!noslip_angle_ok_f(own->heading)) {
            return 0;
        }
        noslip_course_place_f(last, last->length, &own->x, &own->y);
    }
    *count += 1;
    if (terms > 1) {
        turn = length * noslip_course_bend_f(own, 1);
    }
    return noslip_sum_finite_f(own->begin, own->x, own->y) && turn < NOSLIP_COURSE_TURN;
}

/* Adds a part of a course without rounding: four derivatives of its curvature are continuous. Returns as the last. */
static inline int noslip_course_blend_f(noslip_stretch_f *stretches, int *count,
                             const noslip_course_options_f *options, int part)
{
    static const float smooth[9] = {0, 0, 0, 0, 126, -420, 540, -315, 70};
    const float change = options->curvatures[part + 1] - options->curvatures[part];
    const int terms = change < 0 || change > 0 ? NOSLIP_COURSE_TERMS : 1;
    float curvature[NOSLIP_COURSE_TERMS];
    int k;
    curvature[0] = options->curvatures[part];
    for (k = 0; k < 9; k++) {
        curvature[k + 1] = change * smooth[k];
    }
    return noslip_course_add_f(stretches, count, options->lengths[part], curvature, terms);
}

/* Returns the rate of the curvature of a part of a course with rounding, 1/m^2; 0 after the last. */
static inline float noslip_course_rate_f(const noslip_course_options_f *options, int part)
{
    return part < options->count ? (options->curvatures[part + 1] - options->curvatures[part]) / options->lengths[part]
                                 : (float)0;
}

/* Adds a part of a course with rounding: a line, arc or clothoid, and the way from there to the next. */
static inline int noslip_course_round_f(noslip_stretch_f *stretches, int *count,
                             const noslip_course_options_f *options, int part)
{
    static const float rise[7] = {0, 0, 0, 7, -14, 10, (float)-2.5};
    const float rate = noslip_course_rate_f(options, part), half = options->rounding / 2;
    const float change = (noslip_course_rate_f(options, part + 1) - rate) * options->rounding;
    const float begin = part > 0 ? half : (float)0, straight = options->lengths[part] - begin - half;
    const int terms = rate < 0 || rate > 0 ? 2 : 1;
    float curvature[NOSLIP_COURSE_TERMS];
    int k;
    if (straight > 0) {
        curvature[0] = options->curvatures[part] + rate * begin;
        curvature[1] = rate * straight;
        if (!noslip_course_add_f(stretches, count, straight, curvature, terms)) {
            return 0;
        }
    }
    curvature[0] = options->curvatures[part + 1] - rate * half;
    curvature[1] = rate * options->rounding;
    for (k = 0; k < 7; k++) {
        curvature[k + 2] = change * rise[k];
    }
    return noslip_course_add_f(stretches, count, options->rounding, curvature, NOSLIP_COURSE_TERMS - 1);
}

/* Returns 1 if each number of the options is one that a course can have. */
static inline int noslip_course_options_ok_f(const noslip_course_options_f *options)
{
    int good = noslip_is_finite_f(options->x) && noslip_is_finite_f(options->y), k;
    good = good && noslip_angle_ok_f(options->heading) && noslip_is_finite_f(options->rounding);
    good = good && options->rounding >= 0 && noslip_is_finite_f(options->curvatures[0]);
    for (k = 0; k < options->count && good; k++) {
        good = noslip_is_positive_f(options->lengths[k]) && options->lengths[k] >= options->rounding &&
               noslip_is_finite_f(options->curvatures[k + 1]);
    }
    return good;
}

/*
 * Initializes. `stretches` is the caller's memory for `room` of them, NOSLIP_COURSE_ROOM(count), which must live as long as the
 * course; the options and their arrays need not. Returns NOSLIP_NULL, NOSLIP_FULL if the room is too small, NOSLIP_BAD_PARAMETER
 * for numbers that a course cannot have: see the options. A part whose curvature is not constant may turn by less than
 * NOSLIP_COURSE_TURN rad.
 */
NOSLIP_NODISCARD static inline int noslip_course_init_f(noslip_course_f *self,
                                             noslip_stretch_f *stretches, int room,
                                             const noslip_course_options_f *options)
{
    int count = 0, good, k;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (stretches == NULL || options == NULL || options->curvatures == NULL || options->lengths == NULL) {
        return NOSLIP_NULL;
    }
    if (options->count < 0) {
        return NOSLIP_BAD_PARAMETER;
    }
    if (room < 1 || options->count > (room - 1) / 2) {
        return NOSLIP_FULL;
    }
    good = noslip_course_options_ok_f(options);
    stretches[0].begin = 0;
    stretches[0].x = options->x;
    stretches[0].y = options->y;
    stretches[0].heading = options->heading;
    for (k = 0; k < options->count && good; k++) {
        good = options->rounding > 0 ? noslip_course_round_f(stretches, &count, options, k)
                                     : noslip_course_blend_f(stretches, &count, options, k);
    }
    if (!good || !noslip_course_add_f(stretches, &count, 1, &options->curvatures[options->count], 1)) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->stretches = stretches;
    self->count = count;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/*
 * Writes the point `length` m along the course, and its derivatives by time if it moves with a constant `speed` (m/s): the
 * reference of an output whose first two rows are a position. Before its beginning the first curvature stays, after its end the
 * last.
 * On an error nothing is written: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_RANGE where the direction is too large.
 */
NOSLIP_NODISCARD static inline int noslip_course_at_f(const noslip_course_f *self, float length,
                                     float speed, noslip_course_point_f *point)
{
    const noslip_stretch_f *stretch;
    noslip_course_point_f own;
    float rate[NOSLIP_COURSE_ORDER - 1], along, direction, factor, sine, cosine, size = 0;
    int n, k, choose;
    if (self == NULL || point == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_is_finite_f(length) || !noslip_is_finite_f(speed)) {
        return NOSLIP_NONFINITE;
    }
    stretch = noslip_course_stretch_f(self, length);
    along = length - stretch->begin;
    direction = noslip_course_direction_f(stretch, along);
    if (!noslip_angle_ok_f(direction)) {
        return NOSLIP_RANGE;
    }
    factor = speed;
    for (n = 0; n < NOSLIP_COURSE_ORDER - 1; n++) {
        rate[n] = factor * noslip_course_curvature_f(stretch, along / stretch->length, n);
        factor *= speed / stretch->length;
    }
    noslip_sincos_f(direction, &sine, &cosine);
    own.x[1] = speed * cosine;
    own.y[1] = speed * sine;
    for (n = 0; n < NOSLIP_COURSE_ORDER - 1; n++) { /* the derivative of a vector that turns at the rate rate[0] */
        choose = 1;
        own.x[n + 2] = 0;
        own.y[n + 2] = 0;
        for (k = 0; k <= n; k++) {
            own.x[n + 2] -= (float)choose * rate[k] * own.y[n + 1 - k];
            own.y[n + 2] += (float)choose * rate[k] * own.x[n + 1 - k];
            choose = choose * (n - k) / (k + 1);
        }
    }
    noslip_course_place_f(stretch, along, &own.x[0], &own.y[0]);
    for (n = 0; n <= NOSLIP_COURSE_ORDER; n++) {
        size += noslip_abs_f(own.x[n]) + noslip_abs_f(own.y[n]);
    }
    if (!noslip_is_finite_f(size)) {
        return NOSLIP_NONFINITE;
    }
    for (n = 0; n <= NOSLIP_COURSE_ORDER; n++) {
        point->x[n] = own.x[n];
        point->y[n] = own.y[n];
    }
    return NOSLIP_OK;
}

/*
 * Searches the length along the course, m, at which it is nearest to (x, y), m, by Newton's method from `length`, that of the call
 * before: a vehicle then follows the course from wherever it is beside it. On an error nothing changes: NOSLIP_NULL,
 * NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_RANGE, NOSLIP_SINGULAR if the point is as far as the centre of curvature, or too far
 * ahead for NOSLIP_COURSE_STEPS steps.
 */
NOSLIP_NODISCARD static inline int noslip_course_nearest_f(const noslip_course_f *self, float x,
                                          float y, float *length)
{
    float found, along, direction, sine, cosine, place[2], ahead, slope, step;
    int k;
    if (self == NULL || length == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    found = *length;
    for (k = 0; k < NOSLIP_COURSE_STEPS; k++) {
        const noslip_stretch_f *stretch;
        if (!noslip_sum_finite_f(x, y, found)) {
            return NOSLIP_NONFINITE;
        }
        stretch = noslip_course_stretch_f(self, found);
        along = found - stretch->begin;
        direction = noslip_course_direction_f(stretch, along);
        if (!noslip_angle_ok_f(direction)) {
            return NOSLIP_RANGE;
        }
        noslip_sincos_f(direction, &sine, &cosine);
        noslip_course_place_f(stretch, along, &place[0], &place[1]);
        ahead = (x - place[0]) * cosine + (y - place[1]) * sine;
        slope = 1 - noslip_course_curvature_f(stretch, along / stretch->length, 0) *
                    ((y - place[1]) * cosine - (x - place[0]) * sine);
        if (!(slope > (float)NOSLIP_COURSE_FLATTEST)) {
            return NOSLIP_SINGULAR;
        }
        step = ahead / slope;
        found += step;
        if (step * step <= FLT_EPSILON) {    /* the next one is about its square */
            if (!noslip_is_finite_f(found)) {
                return NOSLIP_NONFINITE;
            }
            *length = found;
            return NOSLIP_OK;
        }
    }
    return NOSLIP_SINGULAR;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
