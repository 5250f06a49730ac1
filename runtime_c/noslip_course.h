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
 * A course may have cusps, where lengths change their sign: the vehicle stops there and drives back. A tracker holds the piece
 * that is followed. For a law of Type IV along a course, with the pose of the vehicle's point and its forward speed:
 *
 *     const noslip_course_tracker_options_f options = {.speed = 0.5f, .deceleration = 0.3f, .L = {-0.3f, -0.3f}, .ahead = 0.3f};
 *     status = noslip_course_tracker_init_f(&tracker, &course, &options);
 *     status = noslip_course_tracker_update_f(&tracker, x, y, heading, forward_speed, &guide);
 *     config.x_s = guide.x; config.curvature = guide.curvature[0]; and so on; reference.speed = guide.speed
 *
 * A piece ends where P_l, or with NOSLIP_STOP_AXLE the axle, has reached its end and the vehicle stands, |forward_speed| <= creep. It
 * is not followed again, wherever the vehicle is moved to. Beyond its end its last curvature stays. Before a stop the desired speed
 * is sqrt(2 deceleration left), at most `speed` and at least `creep`; from the stop on it is 0. At the end the status is
 * NOSLIP_ARRIVED.
 *
 * A call computes two sines and cosines on lines and arcs, 9 on clothoids, 25 elsewhere, and 8 more for each radian that a stretch
 * turns; noslip_course_nearest as many for each of its steps, two or three if the vehicle goes on as before.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_COURSE_H
#define NOSLIP_COURSE_H

#include "noslip_path.h"
#include "noslip_reversing.h"

#define NOSLIP_COURSE_ORDER 6                       /* of the highest derivative */
#define NOSLIP_COURSE_BENDS (NOSLIP_COURSE_ORDER - 1) /* curvature and derivatives of it */
#define NOSLIP_COURSE_TERMS 10                      /* of the polynomial of a curvature */
#define NOSLIP_COURSE_TURN 16                       /* rad: that a stretch may turn */
#define NOSLIP_COURSE_STEPS 20                      /* of Newton's method, at most */
#define NOSLIP_COURSE_BACK 3.141592653589793         /* rad: by which the direction of travel turns at a cusp */
#define NOSLIP_COURSE_FLATTEST 0.1                  /* how near a point may be to the centre of curvature, in radii */
#define NOSLIP_COURSE_ROOM(count) (2 * (count) + 1) /* stretches for so many parts */

/* -- double: generated from noslip_course.inc by guarantees/headers.py ------------------------------------------------- */

/* What a course is made of. Read by init only. */
typedef struct noslip_course_options {
    double x, y;                   /* m: where it begins */
    double heading;                /* rad: its direction there */
    const double *lengths;         /* m: of its parts, negative: in reverse, against the direction; where the sign changes is a cusp */
    const double *curvatures;      /* 1/m, positive turns left of the direction: where each part begins, and where the last ends */
    int count;                     /* of the lengths; there is one curvature more */
    double rounding;               /* m, at most the shortest of the lengths; 0: the curvature changes over each part */
} noslip_course_options;

/* A stretch over which the curvature is a polynomial in the part of its length. */
typedef struct noslip_stretch {
    double begin;                                  /* m: along the course */
    double length;                                 /* m */
    double x, y, heading;                          /* m, rad: where it begins, and the direction of travel there */
    double curvature[NOSLIP_COURSE_TERMS];         /* 1/m, positive turns left of the direction of travel: coefficients by power */
    int terms;                                     /* how many of them there are */
    int backward;                                  /* 1: in reverse */
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

/* Returns the stretch at a length along the course, of those numbered `first` to `last`; before they begin the first. */
static inline const noslip_stretch *noslip_course_stretch(const noslip_course *self,
                                             int first, int last, double length)
{
    int k = last;
    while (k > first && length < self->stretches[k].begin) {
        k--;
    }
    return &self->stretches[k];
}

/*
 * Adds a stretch whose curvature, positive to the left of the course's direction, has these coefficients; in reverse after one
 * forward, or the other way round, it begins where that of the end before it does, and leads back. Returns 1, or 0 if it is too
 * long or turns too far, or there is no room.
 */
static inline int noslip_course_add(noslip_stretch *stretches, int room, int *count,
                       double length, const double *curvature, int terms)
{
    noslip_stretch *own;
    double turn = 0;
    int k;
    if (*count < 0 || *count >= room) {
        return 0;
    }
    own = &stretches[*count];
    own->length = noslip_abs(length);
    own->terms = terms;
    own->backward = length < 0;
    for (k = 0; k < terms; k++) {
        own->curvature[k] = own->backward ? -curvature[k] : curvature[k];
    }
    if (*count > 0) {
        const noslip_stretch *last = &stretches[*count - 1];
        if (own->backward == last->backward) {
            own->begin = last->begin + last->length;
            own->heading = noslip_course_direction(last, last->length);
            if (!noslip_angle_ok(own->heading)) {
                return 0;
            }
            noslip_course_place(last, last->length, &own->x, &own->y);
        } else {
            own->begin = last->begin;
            own->heading =
                last->heading + (own->backward ? (double)NOSLIP_COURSE_BACK : -(double)NOSLIP_COURSE_BACK);
            own->x = last->x;
            own->y = last->y;
        }
    }
    *count += 1;
    if (terms > 1) {
        turn = own->length * noslip_course_bend(own, 1);
    }
    return noslip_sum_finite(own->begin, own->x, own->y) && noslip_angle_ok(own->heading) &&
           turn < NOSLIP_COURSE_TURN;
}

/* Returns 1 if a part ends, at its end, at a cusp or with the course. */
static inline int noslip_course_ends(const noslip_course_options *options, int part)
{
    return part + 1 >= options->count || (options->lengths[part] < 0) != (options->lengths[part + 1] < 0);
}

/* Adds what leads on from the end of a part, where vehicles that overshoot are: the curvature stays. Returns as the last. */
static inline int noslip_course_lead_on(noslip_stretch *stretches, int room, int *count,
                           const noslip_course_options *options, int part)
{
    const double length = part >= 0 && options->lengths[part] < 0 ? (double)-1 : (double)1;
    return noslip_course_add(stretches, room, count, length, &options->curvatures[part + 1], 1);
}

/* Adds a part of a course without rounding: four derivatives of its curvature are continuous. Returns as the last. */
static inline int noslip_course_blend(noslip_stretch *stretches, int room, int *count,
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
    return noslip_course_add(stretches, room, count, options->lengths[part], curvature, terms);
}

/* Returns the rate of the curvature along a part of a course with rounding, 1/m^2. */
static inline double noslip_course_rate(const noslip_course_options *options, int part)
{
    return (options->curvatures[part + 1] - options->curvatures[part]) / noslip_abs(options->lengths[part]);
}

/* Adds a part of a course with rounding: a line, arc or clothoid, and the way from there to the next. */
static inline int noslip_course_round(noslip_stretch *stretches, int room, int *count,
                         const noslip_course_options *options, int part)
{
    static const double rise[7] = {0, 0, 0, 7, -14, 10, (double)-2.5};
    const double rate = noslip_course_rate(options, part), half = options->rounding / 2;
    const int ends = noslip_course_ends(options, part), cusp = ends && part + 1 < options->count;
    const double after = ends ? (double)0 : noslip_course_rate(options, part + 1);
    const double change = (after - rate) * options->rounding;
    const double begin = part > 0 && !noslip_course_ends(options, part - 1) ? half : (double)0;
    const double straight = noslip_abs(options->lengths[part]) - begin - (cusp ? (double)0 : half);
    const double way = options->lengths[part] < 0 ? (double)-1 : (double)1;
    const int terms = rate < 0 || rate > 0 ? 2 : 1;
    double curvature[NOSLIP_COURSE_TERMS];
    int k;
    if (straight > 0) {
        curvature[0] = options->curvatures[part] + rate * begin;
        curvature[1] = rate * straight;
        if (!noslip_course_add(stretches, room, count, way * straight, curvature, terms)) {
            return 0;
        }
    }
    if (cusp) {
        return 1;
    }
    curvature[0] = options->curvatures[part + 1] - rate * half;
    curvature[1] = rate * options->rounding;
    for (k = 0; k < 7; k++) {
        curvature[k + 2] = change * rise[k];
    }
    return noslip_course_add(stretches, room, count, way * options->rounding, curvature, NOSLIP_COURSE_TERMS - 1);
}

/* Returns 1 unless a part with rounding ends at a cusp beside which the curvature changes: its rate would jump there. */
static inline int noslip_course_cusp_ok(const noslip_course_options *options, int part)
{
    return !(options->rounding > 0) || part + 1 >= options->count || !noslip_course_ends(options, part) ||
           !(noslip_abs(noslip_course_rate(options, part)) +
                 noslip_abs(noslip_course_rate(options, part + 1)) >
             0);
}

/* Returns 1 if each number of the options is one that a course can have. */
static inline int noslip_course_options_ok(const noslip_course_options *options)
{
    int good = noslip_is_finite(options->x) && noslip_is_finite(options->y), k;
    good = good && noslip_angle_ok(options->heading) && noslip_is_finite(options->rounding);
    good = good && options->rounding >= 0 && noslip_is_finite(options->curvatures[0]);
    for (k = 0; k < options->count && good; k++) {
        const double length = noslip_abs(options->lengths[k]);
        good = noslip_is_positive(length) && length >= options->rounding &&
               noslip_is_finite(options->curvatures[k + 1]);
    }
    for (k = 0; k < options->count && good; k++) {
        good = noslip_course_cusp_ok(options, k);
    }
    return good;
}

/*
 * Initializes. `stretches` is the caller's memory for `room` of them, NOSLIP_COURSE_ROOM(count), which must live as long as the
 * course; the options and their arrays need not. Returns NOSLIP_NULL, NOSLIP_FULL if the room is too small, NOSLIP_BAD_PARAMETER
 * for numbers that a course cannot have: see the options. A part whose curvature is not constant may turn by less than
 * NOSLIP_COURSE_TURN rad. With a rounding, parts that meet at a cusp have the same, constant curvature.
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
    for (k = 0; k < room; k++) {
        stretches[k].terms = 1; /* of those that no part needs, too */
    }
    stretches[0].begin = 0;
    stretches[0].x = options->x;
    stretches[0].y = options->y;
    stretches[0].heading = options->heading;
    if (options->count > 0 && options->lengths[0] < 0) {
        stretches[0].heading += (double)NOSLIP_COURSE_BACK;
    }
    for (k = 0; k < options->count && good; k++) {
        good = options->rounding > 0 ? noslip_course_round(stretches, room, &count, options, k)
                                     : noslip_course_blend(stretches, room, &count, options, k);
        if (good && noslip_course_ends(options, k)) {
            good = noslip_course_lead_on(stretches, room, &count, options, k);
        }
    }
    if (options->count == 0) {
        good = good && noslip_course_lead_on(stretches, room, &count, options, -1);
    }
    if (!good || count < 1) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->stretches = stretches;
    self->count = count;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* Computes the derivatives by time of the direction (rad) `along` m after the beginning of a stretch, from the first on, at a speed. */
static inline void noslip_course_bends(const noslip_stretch *stretch, double along,
                     double speed, double rate[NOSLIP_COURSE_BENDS])
{
    double factor = speed;
    int n;
    for (n = 0; n < NOSLIP_COURSE_BENDS; n++) {
        rate[n] = factor * noslip_course_curvature(stretch, along / stretch->length, n);
        factor *= speed / stretch->length;
    }
}

/*
 * Writes the point `length` m along the course, and its derivatives by time if it moves with a constant `speed` (m/s): the
 * reference of an output whose first two rows are a position. Before its beginning the first curvature stays, after its end the
 * last. At a cusp the direction of travel jumps.
 * On an error nothing is written: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_RANGE where the direction is too large.
 */
NOSLIP_NODISCARD static inline int noslip_course_at(const noslip_course *self, double length,
                                  double speed, noslip_course_point *point)
{
    const noslip_stretch *stretch;
    noslip_course_point own;
    double rate[NOSLIP_COURSE_BENDS], along, direction, sine, cosine, size = 0;
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
    stretch = noslip_course_stretch(self, 0, self->count - 1, length);
    along = length - stretch->begin;
    direction = noslip_course_direction(stretch, along);
    if (!noslip_angle_ok(direction)) {
        return NOSLIP_RANGE;
    }
    noslip_course_bends(stretch, along, speed, rate);
    noslip_sincos(direction, &sine, &cosine);
    own.x[1] = speed * cosine;
    own.y[1] = speed * sine;
    for (n = 0; n < NOSLIP_COURSE_BENDS; n++) { /* the derivative of a vector that turns at the rate rate[0] */
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
 * Searches the length along the stretches numbered `first` to `last`, m, at which they are nearest to (x, y), m, by Newton's method
 * from `length`. Errors as for noslip_course_nearest.
 */
static inline int noslip_course_search(const noslip_course *self, int first, int last, double x,
                     double y, double *length)
{
    double found = *length, along, direction, sine, cosine, place[2], ahead, slope, step;
    int k;
    for (k = 0; k < NOSLIP_COURSE_STEPS; k++) {
        const noslip_stretch *stretch;
        if (!noslip_sum_finite(x, y, found)) {
            return NOSLIP_NONFINITE;
        }
        stretch = noslip_course_stretch(self, first, last, found);
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

/*
 * Searches the length along the course, m, at which it is nearest to (x, y), m, by Newton's method from `length`, that of the call
 * before: a vehicle then follows the course from wherever it is beside it. On an error nothing changes: NOSLIP_NULL,
 * NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_RANGE, NOSLIP_SINGULAR if the point is as far as the centre of curvature, or too far
 * ahead for NOSLIP_COURSE_STEPS steps. On a course with cusps use noslip_course_tracker_update.
 */
NOSLIP_NODISCARD static inline int noslip_course_nearest(const noslip_course *self, double x,
                                       double y, double *length)
{
    if (self == NULL || length == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    return noslip_course_search(self, 0, self->count - 1, x, y, length);
}

/* Options of following a course. Zero selects the default, except for `speed`, which is required. */
typedef struct noslip_course_tracker_options {
    double speed;             /* m/s: along the course between stops; negative: the vehicle faces against the course */
    double deceleration;      /* m/s^2: before a stop; 0: the desired speed drops to 0 at the stop */
    double creep;             /* m/s: lowest desired speed before a stop; the vehicle counts as standing below it; 0: 0.01 */
    double window;            /* m: how far the nearest point may have moved along the course since the last update; 0: any way */
    double start;             /* m: length along the course from which the nearest point is searched at first, on the first piece */
    double L[2];              /* m: distance of P_l ahead of the vehicle's point, driving forward [0] and in reverse [1] */
    double W;                 /* m: distance of P_l to the left of the vehicle's point */
    double ahead;             /* m: distance of the vehicle's point ahead of the middle of the axle */
    noslip_on_reversing reversing; /* NOSLIP_ALLOW: P_l may be on the side of the axle on which the heading diverges */
    noslip_path_stop stop;    /* NOSLIP_STOP_POINT or NOSLIP_STOP_AXLE */
    int endless;              /* 1: it does not stop at the end, after which the last curvature stays */
} noslip_course_tracker_options;

/* The piece of a course that is followed, and the point nearest to P_l. Part of noslip_course_tracker. */
typedef struct noslip_course_place_on {
    int first, last;    /* its stretches: the last leads on from its end */
    int piece;          /* cusps that were passed */
    int stopped;        /* 1: the stop at its end is reached */
    double length;      /* m: along the course */
} noslip_course_place_on;

/* A vehicle on a course: initialized by init, owned by the caller, who does not write to it. */
typedef struct noslip_course_tracker {
    const noslip_course *course;
    noslip_course_tracker_options options;
    noslip_course_place_on now;
    int started; /* NOSLIP_READY after the first update */
    int ready;
} noslip_course_tracker;

/* The point of a course nearest to P_l, and the desired speed. */
typedef struct noslip_course_guide {
    int piece;             /* cusps that were passed */
    int backward;          /* 1: the vehicle drives in reverse */
    int changed;           /* 1: the piece differs from the last update, or is the first: initialize the law */
    int waiting;           /* 1: at a cusp, until |forward_speed| <= creep */
    int arrived;           /* 1: the end is reached */
    double L;              /* m: the L of P_l to use now */
    double length;         /* m: along the course, whatever the direction */
    double distance;       /* m: of P_l to the left of the direction of travel */
    double left;           /* m: to the stop; the piece ends at 0 or below. While waiting, m/s: |forward_speed| - creep. When arrived,
                              or without a stop: the largest number */
    double x, y;           /* m */
    double direction;      /* rad: of travel */
    double curvature[NOSLIP_COURSE_BENDS];      /* 1/m, positive turns left, and its derivatives by the length */
    double speed;           /* m/s: desired forward speed of the vehicle, negative in reverse */
    double speed_rate;      /* m/s^2: derivative of `speed` along the motion */
} noslip_course_guide;

/* Returns the number of the last stretch of a piece. */
static inline int noslip_course_last(const noslip_course *course, int first)
{
    int k = first;
    while (k + 1 < course->count && course->stretches[k + 1].backward == course->stretches[first].backward) {
        k++;
    }
    return k;
}

/* Returns 1 if the vehicle drives in reverse on the piece of a place. */
static inline int noslip_course_backward(const noslip_course_tracker *self,
                            const noslip_course_place_on *now)
{
    return self->course->stretches[now->first].backward != (self->options.speed < 0);
}

/* Returns how far P_l is ahead of the axle, m; without sign how far it moves on where the axle stops. */
static inline double noslip_course_lookahead(const noslip_course_tracker_options *options,
                                int backward)
{
    return options->L[backward] + options->ahead;
}

/* Returns how much of the piece is left to the stop, m; the largest number if there is none. */
static inline double noslip_course_left(const noslip_course_tracker *self,
                           const noslip_course_place_on *now)
{
    const double left = self->course->stretches[now->last].begin - now->length;
    if (self->options.endless && now->last + 1 >= self->course->count) {
        return DBL_MAX;
    }
    if (self->options.stop == NOSLIP_STOP_POINT) {
        return left;
    }
    return left + noslip_abs(
                      noslip_course_lookahead(&self->options, noslip_course_backward(self, now)));
}

/* Searches the point nearest to P_l on the piece of a place; `pose` is x, y (m), cosine and sine of the heading. */
static inline int noslip_course_locate(const noslip_course_tracker *self, const double pose[4],
                     noslip_course_place_on *now)
{
    const double L = self->options.L[noslip_course_backward(self, now)], W = self->options.W;
    return noslip_course_search(self->course, now->first, now->last, pose[0] + L * pose[2] - W * pose[3],
                                             pose[1] + L * pose[3] + W * pose[2], &now->length);
}

/* Searches the place at a pose, and goes on to the next piece if `moves` and the vehicle stands at a cusp. */
static inline int noslip_course_advance(const noslip_course_tracker *self, const double pose[4],
                      double forward_speed, int moves,
                      noslip_course_place_on *now)
{
    const double before = now->length;
    int status = noslip_course_locate(self, pose, now);
    if (status == NOSLIP_OK && self->options.window > 0 && self->started == NOSLIP_READY &&
        !(noslip_abs(now->length - before) <= self->options.window)) {
        return NOSLIP_SINGULAR;
    }
    if (status == NOSLIP_OK && moves) {
        now->stopped = now->stopped || noslip_course_left(self, now) <= 0;
        if (now->stopped && now->last + 1 < self->course->count &&
            noslip_abs(forward_speed) <= self->options.creep) {
            now->first = now->last + 1;
            now->last = noslip_course_last(self->course, now->first);
            now->piece += 1;
            now->stopped = 0;
            now->length = self->course->stretches[now->first].begin;
            status = noslip_course_locate(self, pose, now);
        }
    }
    return status;
}

/* Computes the guide at a place, which it writes unless there is an error. Returns NOSLIP_ARRIVED at the end. */
static inline int noslip_course_guided(const noslip_course_tracker *self, const double pose[4],
                     double forward_speed,
                     const noslip_course_place_on *now,
                     noslip_course_guide *guide)
{
    const noslip_course_tracker_options *options = &self->options;
    const noslip_stretch *stretch =
        noslip_course_stretch(self->course, now->first, now->last, now->length);
    const double along = now->length - stretch->begin, top = noslip_abs(options->speed);
    const double direction = noslip_course_direction(stretch, along);
    const int backward = noslip_course_backward(self, now);
    const int waiting = now->stopped && now->last + 1 < self->course->count;
    double left = noslip_course_left(self, now), speed = backward ? -top : top, speed_rate = 0, size = 0;
    double curvature[NOSLIP_COURSE_BENDS], sine, cosine, x, y, distance;
    int k;
    if (!noslip_angle_ok(direction)) {
        return NOSLIP_RANGE;
    }
    if (now->stopped) {
        speed = 0;
        left = waiting ? noslip_abs(forward_speed) - options->creep : DBL_MAX;
    } else if (options->deceleration > 0 && 2 * options->deceleration * left < top * top) {
        noslip_slow_down(left, 2 * options->deceleration, options->creep, top, backward,
                                      backward ? options->deceleration : -options->deceleration, forward_speed, &speed,
                                      &speed_rate);
    }
    noslip_course_bends(stretch, along, 1, curvature);
    for (k = 0; k < NOSLIP_COURSE_BENDS; k++) {
        size += noslip_abs(curvature[k]);
    }
    noslip_sincos(direction, &sine, &cosine);
    noslip_course_place(stretch, along, &x, &y);
    distance = cosine * (pose[1] - y) - sine * (pose[0] - x) + options->L[backward] * (cosine * pose[3] - sine * pose[2]) +
               options->W * (cosine * pose[2] + sine * pose[3]);
    size += noslip_abs(x) + noslip_abs(y) + noslip_abs(distance);
    if (!noslip_sum_finite(size, speed, speed_rate) || !noslip_is_finite(left)) {
        return NOSLIP_NONFINITE;
    }
    guide->piece = now->piece;
    guide->backward = backward;
    guide->changed = self->started != NOSLIP_READY || now->piece != self->now.piece;
    guide->waiting = waiting;
    guide->arrived = now->stopped && !waiting;
    guide->L = options->L[backward];
    guide->length = now->length;
    guide->distance = distance;
    guide->left = left;
    guide->x = x;
    guide->y = y;
    guide->direction = direction;
    for (k = 0; k < NOSLIP_COURSE_BENDS; k++) {
        guide->curvature[k] = curvature[k];
    }
    guide->speed = speed;
    guide->speed_rate = speed_rate;
    return guide->arrived ? NOSLIP_ARRIVED : NOSLIP_OK;
}

/* Returns NOSLIP_OK, or why a pose cannot be used; writes x, y, cosine and sine of the heading. */
static inline int noslip_course_pose(const noslip_course_tracker *self, double x, double y,
              double heading, double forward_speed, double pose[4])
{
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_sum_finite(x, y, forward_speed) || !noslip_is_finite(heading)) {
        return NOSLIP_NONFINITE;
    }
    if (!noslip_angle_ok(heading)) {
        return NOSLIP_RANGE;
    }
    pose[0] = x;
    pose[1] = y;
    noslip_sincos(heading, &pose[3], &pose[2]);
    return NOSLIP_OK;
}

/* Returns 1 if each number of the options is one that a tracker can have. */
static inline int noslip_course_tracker_ok(const noslip_course_tracker_options *options)
{
    const double top = noslip_abs(options->speed);
    return noslip_is_positive(top) &&
           noslip_sum_finite(options->deceleration, options->creep, options->window) && options->deceleration >= 0 &&
           options->creep >= 0 && options->window >= 0 &&
           noslip_sum_finite(options->L[0], options->L[1], options->W) &&
           noslip_is_finite(options->ahead) && noslip_is_finite(options->start) &&
           (options->stop == NOSLIP_STOP_POINT || options->stop == NOSLIP_STOP_AXLE);
}

/* Returns NOSLIP_OK, or why the pieces of the course cannot be followed with these options. */
static inline int noslip_course_pieces(const noslip_course_tracker *self)
{
    const noslip_course_tracker_options *options = &self->options;
    const double passed = noslip_abs(noslip_course_lookahead(options, 0)) +
                               noslip_abs(noslip_course_lookahead(options, 1));
    int k;
    for (k = 0; k < self->course->count; k++) {
        const noslip_stretch *own = &self->course->stretches[k];
        const int backward = own->backward != (options->speed < 0);
        if (options->reversing != NOSLIP_ALLOW &&
            noslip_diverges(backward ? (double)-1 : (double)1,
                                         noslip_course_lookahead(options, backward))) {
            return NOSLIP_UNSTABLE;
        }
        if (k > 0 && self->course->stretches[k - 1].backward != own->backward && options->stop == NOSLIP_STOP_POINT &&
            !(self->course->stretches[noslip_course_last(self->course, k)].begin - own->begin > passed)) {
            return NOSLIP_BAD_PATH;
        }
    }
    return NOSLIP_OK;
}

/*
 * Initializes a tracker at the beginning of a course, which must live as long as it. Returns NOSLIP_NULL, NOSLIP_NOT_READY if the
 * course is not, NOSLIP_BAD_PARAMETER for the options, NOSLIP_UNSTABLE if P_l is on the wrong side of the axle for the direction of
 * a piece, NOSLIP_BAD_PATH if a piece is so short that P_l has passed it when it has changed sides.
 */
NOSLIP_NODISCARD static inline int noslip_course_tracker_init(
    noslip_course_tracker *self, const noslip_course *course,
    const noslip_course_tracker_options *options)
{
    noslip_course_tracker_options *own;
    int status;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (course == NULL || options == NULL) {
        return NOSLIP_NULL;
    }
    if (course->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_course_tracker_ok(options)) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->course = course;
    own = &self->options; /* by members: an assignment may call memcpy */
    own->speed = options->speed;
    own->deceleration = options->deceleration;
    own->creep = options->creep > 0 ? options->creep : (double)0.01;
    own->window = options->window;
    own->start = options->start;
    own->L[0] = options->L[0];
    own->L[1] = options->L[1];
    own->W = options->W;
    own->ahead = options->ahead;
    own->reversing = options->reversing;
    own->stop = options->stop;
    own->endless = options->endless;
    self->now.first = 0;
    self->now.last = noslip_course_last(course, 0);
    self->now.piece = 0;
    self->now.stopped = 0;
    self->now.length = options->start;
    self->started = 0;
    status = noslip_course_pieces(self);
    self->ready = status == NOSLIP_OK ? NOSLIP_READY : 0;
    return status;
}

/*
 * Computes the guide at a pose of the vehicle's point (m, rad) and a forward speed (m/s), on the piece that is followed; the tracker
 * does not change. Returns and errors as for noslip_course_tracker_update.
 */
NOSLIP_NODISCARD static inline int noslip_course_tracker_look(const noslip_course_tracker *self,
                                                 double x, double y, double heading,
                                                 double forward_speed,
                                                 noslip_course_guide *guide)
{
    noslip_course_place_on now;
    double pose[4];
    int status;
    if (self == NULL || guide == NULL) {
        return NOSLIP_NULL;
    }
    status = noslip_course_pose(self, x, y, heading, forward_speed, pose);
    if (status == NOSLIP_OK) {
        now = self->now;
        status = noslip_course_advance(self, pose, forward_speed, 0, &now);
    }
    return status != NOSLIP_OK ? status : noslip_course_guided(self, pose, forward_speed, &now, guide);
}

/*
 * Goes on to the next piece where the vehicle stands at a cusp, and computes the guide. Call it before every step of the law.
 * Returns NOSLIP_ARRIVED once the end is reached. On an error neither the tracker nor the guide changes: NOSLIP_NULL,
 * NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_RANGE, NOSLIP_SINGULAR if P_l is as far from the piece as the centre of its curvature,
 * or its nearest point outside the window.
 */
NOSLIP_NODISCARD static inline int noslip_course_tracker_update(noslip_course_tracker *self, double x,
                                              double y, double heading,
                                              double forward_speed,
                                              noslip_course_guide *guide)
{
    noslip_course_place_on now;
    double pose[4];
    int status;
    if (self == NULL || guide == NULL) {
        return NOSLIP_NULL;
    }
    status = noslip_course_pose(self, x, y, heading, forward_speed, pose);
    if (status != NOSLIP_OK) {
        return status;
    }
    now = self->now;
    status = noslip_course_advance(self, pose, forward_speed, 1, &now);
    if (status == NOSLIP_OK) {
        status = noslip_course_guided(self, pose, forward_speed, &now, guide);
    }
    if (status >= 0) {
        self->now = now;
        self->started = NOSLIP_READY;
    }
    return status;
}

/* -- float: generated from noslip_course.inc by guarantees/headers.py -------------------------------------------------- */

/* What a course is made of. Read by init only. */
typedef struct noslip_course_options_f {
    float x, y;                    /* m: where it begins */
    float heading;                 /* rad: its direction there */
    const float *lengths;          /* m: of its parts, negative: in reverse, against the direction; where the sign changes is a cusp */
    const float *curvatures;       /* 1/m, positive turns left of the direction: where each part begins, and where the last ends */
    int count;                     /* of the lengths; there is one curvature more */
    float rounding;                /* m, at most the shortest of the lengths; 0: the curvature changes over each part */
} noslip_course_options_f;

/* A stretch over which the curvature is a polynomial in the part of its length. */
typedef struct noslip_stretch_f {
    float begin;                                   /* m: along the course */
    float length;                                  /* m */
    float x, y, heading;                           /* m, rad: where it begins, and the direction of travel there */
    float curvature[NOSLIP_COURSE_TERMS];          /* 1/m, positive turns left of the direction of travel: coefficients by power */
    int terms;                                     /* how many of them there are */
    int backward;                                  /* 1: in reverse */
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

/* Returns the stretch at a length along the course, of those numbered `first` to `last`; before they begin the first. */
static inline const noslip_stretch_f *noslip_course_stretch_f(const noslip_course_f *self,
                                                   int first, int last, float length)
{
    int k = last;
    while (k > first && length < self->stretches[k].begin) {
        k--;
    }
    return &self->stretches[k];
}

/*
 * Adds a stretch whose curvature, positive to the left of the course's direction, has these coefficients; in reverse after one
 * forward, or the other way round, it begins where that of the end before it does, and leads back. Returns 1, or 0 if it is too
 * long or turns too far, or there is no room.
 */
static inline int noslip_course_add_f(noslip_stretch_f *stretches, int room, int *count,
                           float length, const float *curvature, int terms)
{
    noslip_stretch_f *own;
    float turn = 0;
    int k;
    if (*count < 0 || *count >= room) {
        return 0;
    }
    own = &stretches[*count];
    own->length = noslip_abs_f(length);
    own->terms = terms;
    own->backward = length < 0;
    for (k = 0; k < terms; k++) {
        own->curvature[k] = own->backward ? -curvature[k] : curvature[k];
    }
    if (*count > 0) {
        const noslip_stretch_f *last = &stretches[*count - 1];
        if (own->backward == last->backward) {
            own->begin = last->begin + last->length;
            own->heading = noslip_course_direction_f(last, last->length);
            if (!noslip_angle_ok_f(own->heading)) {
                return 0;
            }
            noslip_course_place_f(last, last->length, &own->x, &own->y);
        } else {
            own->begin = last->begin;
            own->heading =
                last->heading + (own->backward ? (float)NOSLIP_COURSE_BACK : -(float)NOSLIP_COURSE_BACK);
            own->x = last->x;
            own->y = last->y;
        }
    }
    *count += 1;
    if (terms > 1) {
        turn = own->length * noslip_course_bend_f(own, 1);
    }
    return noslip_sum_finite_f(own->begin, own->x, own->y) && noslip_angle_ok_f(own->heading) &&
           turn < NOSLIP_COURSE_TURN;
}

/* Returns 1 if a part ends, at its end, at a cusp or with the course. */
static inline int noslip_course_ends_f(const noslip_course_options_f *options, int part)
{
    return part + 1 >= options->count || (options->lengths[part] < 0) != (options->lengths[part + 1] < 0);
}

/* Adds what leads on from the end of a part, where vehicles that overshoot are: the curvature stays. Returns as the last. */
static inline int noslip_course_lead_on_f(noslip_stretch_f *stretches, int room, int *count,
                               const noslip_course_options_f *options, int part)
{
    const float length = part >= 0 && options->lengths[part] < 0 ? (float)-1 : (float)1;
    return noslip_course_add_f(stretches, room, count, length, &options->curvatures[part + 1], 1);
}

/* Adds a part of a course without rounding: four derivatives of its curvature are continuous. Returns as the last. */
static inline int noslip_course_blend_f(noslip_stretch_f *stretches, int room, int *count,
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
    return noslip_course_add_f(stretches, room, count, options->lengths[part], curvature, terms);
}

/* Returns the rate of the curvature along a part of a course with rounding, 1/m^2. */
static inline float noslip_course_rate_f(const noslip_course_options_f *options, int part)
{
    return (options->curvatures[part + 1] - options->curvatures[part]) / noslip_abs_f(options->lengths[part]);
}

/* Adds a part of a course with rounding: a line, arc or clothoid, and the way from there to the next. */
static inline int noslip_course_round_f(noslip_stretch_f *stretches, int room, int *count,
                             const noslip_course_options_f *options, int part)
{
    static const float rise[7] = {0, 0, 0, 7, -14, 10, (float)-2.5};
    const float rate = noslip_course_rate_f(options, part), half = options->rounding / 2;
    const int ends = noslip_course_ends_f(options, part), cusp = ends && part + 1 < options->count;
    const float after = ends ? (float)0 : noslip_course_rate_f(options, part + 1);
    const float change = (after - rate) * options->rounding;
    const float begin = part > 0 && !noslip_course_ends_f(options, part - 1) ? half : (float)0;
    const float straight = noslip_abs_f(options->lengths[part]) - begin - (cusp ? (float)0 : half);
    const float way = options->lengths[part] < 0 ? (float)-1 : (float)1;
    const int terms = rate < 0 || rate > 0 ? 2 : 1;
    float curvature[NOSLIP_COURSE_TERMS];
    int k;
    if (straight > 0) {
        curvature[0] = options->curvatures[part] + rate * begin;
        curvature[1] = rate * straight;
        if (!noslip_course_add_f(stretches, room, count, way * straight, curvature, terms)) {
            return 0;
        }
    }
    if (cusp) {
        return 1;
    }
    curvature[0] = options->curvatures[part + 1] - rate * half;
    curvature[1] = rate * options->rounding;
    for (k = 0; k < 7; k++) {
        curvature[k + 2] = change * rise[k];
    }
    return noslip_course_add_f(stretches, room, count, way * options->rounding, curvature, NOSLIP_COURSE_TERMS - 1);
}

/* Returns 1 unless a part with rounding ends at a cusp beside which the curvature changes: its rate would jump there. */
static inline int noslip_course_cusp_ok_f(const noslip_course_options_f *options, int part)
{
    return !(options->rounding > 0) || part + 1 >= options->count || !noslip_course_ends_f(options, part) ||
           !(noslip_abs_f(noslip_course_rate_f(options, part)) +
                 noslip_abs_f(noslip_course_rate_f(options, part + 1)) >
             0);
}

/* Returns 1 if each number of the options is one that a course can have. */
static inline int noslip_course_options_ok_f(const noslip_course_options_f *options)
{
    int good = noslip_is_finite_f(options->x) && noslip_is_finite_f(options->y), k;
    good = good && noslip_angle_ok_f(options->heading) && noslip_is_finite_f(options->rounding);
    good = good && options->rounding >= 0 && noslip_is_finite_f(options->curvatures[0]);
    for (k = 0; k < options->count && good; k++) {
        const float length = noslip_abs_f(options->lengths[k]);
        good = noslip_is_positive_f(length) && length >= options->rounding &&
               noslip_is_finite_f(options->curvatures[k + 1]);
    }
    for (k = 0; k < options->count && good; k++) {
        good = noslip_course_cusp_ok_f(options, k);
    }
    return good;
}

/*
 * Initializes. `stretches` is the caller's memory for `room` of them, NOSLIP_COURSE_ROOM(count), which must live as long as the
 * course; the options and their arrays need not. Returns NOSLIP_NULL, NOSLIP_FULL if the room is too small, NOSLIP_BAD_PARAMETER
 * for numbers that a course cannot have: see the options. A part whose curvature is not constant may turn by less than
 * NOSLIP_COURSE_TURN rad. With a rounding, parts that meet at a cusp have the same, constant curvature.
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
    for (k = 0; k < room; k++) {
        stretches[k].terms = 1; /* of those that no part needs, too */
    }
    stretches[0].begin = 0;
    stretches[0].x = options->x;
    stretches[0].y = options->y;
    stretches[0].heading = options->heading;
    if (options->count > 0 && options->lengths[0] < 0) {
        stretches[0].heading += (float)NOSLIP_COURSE_BACK;
    }
    for (k = 0; k < options->count && good; k++) {
        good = options->rounding > 0 ? noslip_course_round_f(stretches, room, &count, options, k)
                                     : noslip_course_blend_f(stretches, room, &count, options, k);
        if (good && noslip_course_ends_f(options, k)) {
            good = noslip_course_lead_on_f(stretches, room, &count, options, k);
        }
    }
    if (options->count == 0) {
        good = good && noslip_course_lead_on_f(stretches, room, &count, options, -1);
    }
    if (!good || count < 1) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->stretches = stretches;
    self->count = count;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* Computes the derivatives by time of the direction (rad) `along` m after the beginning of a stretch, from the first on, at a speed. */
static inline void noslip_course_bends_f(const noslip_stretch_f *stretch, float along,
                        float speed, float rate[NOSLIP_COURSE_BENDS])
{
    float factor = speed;
    int n;
    for (n = 0; n < NOSLIP_COURSE_BENDS; n++) {
        rate[n] = factor * noslip_course_curvature_f(stretch, along / stretch->length, n);
        factor *= speed / stretch->length;
    }
}

/*
 * Writes the point `length` m along the course, and its derivatives by time if it moves with a constant `speed` (m/s): the
 * reference of an output whose first two rows are a position. Before its beginning the first curvature stays, after its end the
 * last. At a cusp the direction of travel jumps.
 * On an error nothing is written: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_RANGE where the direction is too large.
 */
NOSLIP_NODISCARD static inline int noslip_course_at_f(const noslip_course_f *self, float length,
                                     float speed, noslip_course_point_f *point)
{
    const noslip_stretch_f *stretch;
    noslip_course_point_f own;
    float rate[NOSLIP_COURSE_BENDS], along, direction, sine, cosine, size = 0;
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
    stretch = noslip_course_stretch_f(self, 0, self->count - 1, length);
    along = length - stretch->begin;
    direction = noslip_course_direction_f(stretch, along);
    if (!noslip_angle_ok_f(direction)) {
        return NOSLIP_RANGE;
    }
    noslip_course_bends_f(stretch, along, speed, rate);
    noslip_sincos_f(direction, &sine, &cosine);
    own.x[1] = speed * cosine;
    own.y[1] = speed * sine;
    for (n = 0; n < NOSLIP_COURSE_BENDS; n++) { /* the derivative of a vector that turns at the rate rate[0] */
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
 * Searches the length along the stretches numbered `first` to `last`, m, at which they are nearest to (x, y), m, by Newton's method
 * from `length`. Errors as for noslip_course_nearest.
 */
static inline int noslip_course_search_f(const noslip_course_f *self, int first, int last, float x,
                        float y, float *length)
{
    float found = *length, along, direction, sine, cosine, place[2], ahead, slope, step;
    int k;
    for (k = 0; k < NOSLIP_COURSE_STEPS; k++) {
        const noslip_stretch_f *stretch;
        if (!noslip_sum_finite_f(x, y, found)) {
            return NOSLIP_NONFINITE;
        }
        stretch = noslip_course_stretch_f(self, first, last, found);
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

/*
 * Searches the length along the course, m, at which it is nearest to (x, y), m, by Newton's method from `length`, that of the call
 * before: a vehicle then follows the course from wherever it is beside it. On an error nothing changes: NOSLIP_NULL,
 * NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_RANGE, NOSLIP_SINGULAR if the point is as far as the centre of curvature, or too far
 * ahead for NOSLIP_COURSE_STEPS steps. On a course with cusps use noslip_course_tracker_update.
 */
NOSLIP_NODISCARD static inline int noslip_course_nearest_f(const noslip_course_f *self, float x,
                                          float y, float *length)
{
    if (self == NULL || length == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    return noslip_course_search_f(self, 0, self->count - 1, x, y, length);
}

/* Options of following a course. Zero selects the default, except for `speed`, which is required. */
typedef struct noslip_course_tracker_options_f {
    float speed;              /* m/s: along the course between stops; negative: the vehicle faces against the course */
    float deceleration;       /* m/s^2: before a stop; 0: the desired speed drops to 0 at the stop */
    float creep;              /* m/s: lowest desired speed before a stop; the vehicle counts as standing below it; 0: 0.01 */
    float window;             /* m: how far the nearest point may have moved along the course since the last update; 0: any way */
    float start;              /* m: length along the course from which the nearest point is searched at first, on the first piece */
    float L[2];               /* m: distance of P_l ahead of the vehicle's point, driving forward [0] and in reverse [1] */
    float W;                  /* m: distance of P_l to the left of the vehicle's point */
    float ahead;              /* m: distance of the vehicle's point ahead of the middle of the axle */
    noslip_on_reversing reversing; /* NOSLIP_ALLOW: P_l may be on the side of the axle on which the heading diverges */
    noslip_path_stop stop;    /* NOSLIP_STOP_POINT or NOSLIP_STOP_AXLE */
    int endless;              /* 1: it does not stop at the end, after which the last curvature stays */
} noslip_course_tracker_options_f;

/* The piece of a course that is followed, and the point nearest to P_l. Part of noslip_course_tracker. */
typedef struct noslip_course_place_on_f {
    int first, last;    /* its stretches: the last leads on from its end */
    int piece;          /* cusps that were passed */
    int stopped;        /* 1: the stop at its end is reached */
    float length;       /* m: along the course */
} noslip_course_place_on_f;

/* A vehicle on a course: initialized by init, owned by the caller, who does not write to it. */
typedef struct noslip_course_tracker_f {
    const noslip_course_f *course;
    noslip_course_tracker_options_f options;
    noslip_course_place_on_f now;
    int started; /* NOSLIP_READY after the first update */
    int ready;
} noslip_course_tracker_f;

/* The point of a course nearest to P_l, and the desired speed. */
typedef struct noslip_course_guide_f {
    int piece;             /* cusps that were passed */
    int backward;          /* 1: the vehicle drives in reverse */
    int changed;           /* 1: the piece differs from the last update, or is the first: initialize the law */
    int waiting;           /* 1: at a cusp, until |forward_speed| <= creep */
    int arrived;           /* 1: the end is reached */
    float L;               /* m: the L of P_l to use now */
    float length;          /* m: along the course, whatever the direction */
    float distance;        /* m: of P_l to the left of the direction of travel */
    float left;            /* m: to the stop; the piece ends at 0 or below. While waiting, m/s: |forward_speed| - creep. When arrived,
                              or without a stop: the largest number */
    float x, y;            /* m */
    float direction;       /* rad: of travel */
    float curvature[NOSLIP_COURSE_BENDS];       /* 1/m, positive turns left, and its derivatives by the length */
    float speed;            /* m/s: desired forward speed of the vehicle, negative in reverse */
    float speed_rate;       /* m/s^2: derivative of `speed` along the motion */
} noslip_course_guide_f;

/* Returns the number of the last stretch of a piece. */
static inline int noslip_course_last_f(const noslip_course_f *course, int first)
{
    int k = first;
    while (k + 1 < course->count && course->stretches[k + 1].backward == course->stretches[first].backward) {
        k++;
    }
    return k;
}

/* Returns 1 if the vehicle drives in reverse on the piece of a place. */
static inline int noslip_course_backward_f(const noslip_course_tracker_f *self,
                                const noslip_course_place_on_f *now)
{
    return self->course->stretches[now->first].backward != (self->options.speed < 0);
}

/* Returns how far P_l is ahead of the axle, m; without sign how far it moves on where the axle stops. */
static inline float noslip_course_lookahead_f(const noslip_course_tracker_options_f *options,
                                   int backward)
{
    return options->L[backward] + options->ahead;
}

/* Returns how much of the piece is left to the stop, m; the largest number if there is none. */
static inline float noslip_course_left_f(const noslip_course_tracker_f *self,
                              const noslip_course_place_on_f *now)
{
    const float left = self->course->stretches[now->last].begin - now->length;
    if (self->options.endless && now->last + 1 >= self->course->count) {
        return FLT_MAX;
    }
    if (self->options.stop == NOSLIP_STOP_POINT) {
        return left;
    }
    return left + noslip_abs_f(
                      noslip_course_lookahead_f(&self->options, noslip_course_backward_f(self, now)));
}

/* Searches the point nearest to P_l on the piece of a place; `pose` is x, y (m), cosine and sine of the heading. */
static inline int noslip_course_locate_f(const noslip_course_tracker_f *self, const float pose[4],
                        noslip_course_place_on_f *now)
{
    const float L = self->options.L[noslip_course_backward_f(self, now)], W = self->options.W;
    return noslip_course_search_f(self->course, now->first, now->last, pose[0] + L * pose[2] - W * pose[3],
                                             pose[1] + L * pose[3] + W * pose[2], &now->length);
}

/* Searches the place at a pose, and goes on to the next piece if `moves` and the vehicle stands at a cusp. */
static inline int noslip_course_advance_f(const noslip_course_tracker_f *self, const float pose[4],
                         float forward_speed, int moves,
                         noslip_course_place_on_f *now)
{
    const float before = now->length;
    int status = noslip_course_locate_f(self, pose, now);
    if (status == NOSLIP_OK && self->options.window > 0 && self->started == NOSLIP_READY &&
        !(noslip_abs_f(now->length - before) <= self->options.window)) {
        return NOSLIP_SINGULAR;
    }
    if (status == NOSLIP_OK && moves) {
        now->stopped = now->stopped || noslip_course_left_f(self, now) <= 0;
        if (now->stopped && now->last + 1 < self->course->count &&
            noslip_abs_f(forward_speed) <= self->options.creep) {
            now->first = now->last + 1;
            now->last = noslip_course_last_f(self->course, now->first);
            now->piece += 1;
            now->stopped = 0;
            now->length = self->course->stretches[now->first].begin;
            status = noslip_course_locate_f(self, pose, now);
        }
    }
    return status;
}

/* Computes the guide at a place, which it writes unless there is an error. Returns NOSLIP_ARRIVED at the end. */
static inline int noslip_course_guided_f(const noslip_course_tracker_f *self, const float pose[4],
                        float forward_speed,
                        const noslip_course_place_on_f *now,
                        noslip_course_guide_f *guide)
{
    const noslip_course_tracker_options_f *options = &self->options;
    const noslip_stretch_f *stretch =
        noslip_course_stretch_f(self->course, now->first, now->last, now->length);
    const float along = now->length - stretch->begin, top = noslip_abs_f(options->speed);
    const float direction = noslip_course_direction_f(stretch, along);
    const int backward = noslip_course_backward_f(self, now);
    const int waiting = now->stopped && now->last + 1 < self->course->count;
    float left = noslip_course_left_f(self, now), speed = backward ? -top : top, speed_rate = 0, size = 0;
    float curvature[NOSLIP_COURSE_BENDS], sine, cosine, x, y, distance;
    int k;
    if (!noslip_angle_ok_f(direction)) {
        return NOSLIP_RANGE;
    }
    if (now->stopped) {
        speed = 0;
        left = waiting ? noslip_abs_f(forward_speed) - options->creep : FLT_MAX;
    } else if (options->deceleration > 0 && 2 * options->deceleration * left < top * top) {
        noslip_slow_down_f(left, 2 * options->deceleration, options->creep, top, backward,
                                      backward ? options->deceleration : -options->deceleration, forward_speed, &speed,
                                      &speed_rate);
    }
    noslip_course_bends_f(stretch, along, 1, curvature);
    for (k = 0; k < NOSLIP_COURSE_BENDS; k++) {
        size += noslip_abs_f(curvature[k]);
    }
    noslip_sincos_f(direction, &sine, &cosine);
    noslip_course_place_f(stretch, along, &x, &y);
    distance = cosine * (pose[1] - y) - sine * (pose[0] - x) + options->L[backward] * (cosine * pose[3] - sine * pose[2]) +
               options->W * (cosine * pose[2] + sine * pose[3]);
    size += noslip_abs_f(x) + noslip_abs_f(y) + noslip_abs_f(distance);
    if (!noslip_sum_finite_f(size, speed, speed_rate) || !noslip_is_finite_f(left)) {
        return NOSLIP_NONFINITE;
    }
    guide->piece = now->piece;
    guide->backward = backward;
    guide->changed = self->started != NOSLIP_READY || now->piece != self->now.piece;
    guide->waiting = waiting;
    guide->arrived = now->stopped && !waiting;
    guide->L = options->L[backward];
    guide->length = now->length;
    guide->distance = distance;
    guide->left = left;
    guide->x = x;
    guide->y = y;
    guide->direction = direction;
    for (k = 0; k < NOSLIP_COURSE_BENDS; k++) {
        guide->curvature[k] = curvature[k];
    }
    guide->speed = speed;
    guide->speed_rate = speed_rate;
    return guide->arrived ? NOSLIP_ARRIVED : NOSLIP_OK;
}

/* Returns NOSLIP_OK, or why a pose cannot be used; writes x, y, cosine and sine of the heading. */
static inline int noslip_course_pose_f(const noslip_course_tracker_f *self, float x, float y,
                float heading, float forward_speed, float pose[4])
{
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_sum_finite_f(x, y, forward_speed) || !noslip_is_finite_f(heading)) {
        return NOSLIP_NONFINITE;
    }
    if (!noslip_angle_ok_f(heading)) {
        return NOSLIP_RANGE;
    }
    pose[0] = x;
    pose[1] = y;
    noslip_sincos_f(heading, &pose[3], &pose[2]);
    return NOSLIP_OK;
}

/* Returns 1 if each number of the options is one that a tracker can have. */
static inline int noslip_course_tracker_ok_f(const noslip_course_tracker_options_f *options)
{
    const float top = noslip_abs_f(options->speed);
    return noslip_is_positive_f(top) &&
           noslip_sum_finite_f(options->deceleration, options->creep, options->window) && options->deceleration >= 0 &&
           options->creep >= 0 && options->window >= 0 &&
           noslip_sum_finite_f(options->L[0], options->L[1], options->W) &&
           noslip_is_finite_f(options->ahead) && noslip_is_finite_f(options->start) &&
           (options->stop == NOSLIP_STOP_POINT || options->stop == NOSLIP_STOP_AXLE);
}

/* Returns NOSLIP_OK, or why the pieces of the course cannot be followed with these options. */
static inline int noslip_course_pieces_f(const noslip_course_tracker_f *self)
{
    const noslip_course_tracker_options_f *options = &self->options;
    const float passed = noslip_abs_f(noslip_course_lookahead_f(options, 0)) +
                               noslip_abs_f(noslip_course_lookahead_f(options, 1));
    int k;
    for (k = 0; k < self->course->count; k++) {
        const noslip_stretch_f *own = &self->course->stretches[k];
        const int backward = own->backward != (options->speed < 0);
        if (options->reversing != NOSLIP_ALLOW &&
            noslip_diverges_f(backward ? (float)-1 : (float)1,
                                         noslip_course_lookahead_f(options, backward))) {
            return NOSLIP_UNSTABLE;
        }
        if (k > 0 && self->course->stretches[k - 1].backward != own->backward && options->stop == NOSLIP_STOP_POINT &&
            !(self->course->stretches[noslip_course_last_f(self->course, k)].begin - own->begin > passed)) {
            return NOSLIP_BAD_PATH;
        }
    }
    return NOSLIP_OK;
}

/*
 * Initializes a tracker at the beginning of a course, which must live as long as it. Returns NOSLIP_NULL, NOSLIP_NOT_READY if the
 * course is not, NOSLIP_BAD_PARAMETER for the options, NOSLIP_UNSTABLE if P_l is on the wrong side of the axle for the direction of
 * a piece, NOSLIP_BAD_PATH if a piece is so short that P_l has passed it when it has changed sides.
 */
NOSLIP_NODISCARD static inline int noslip_course_tracker_init_f(
    noslip_course_tracker_f *self, const noslip_course_f *course,
    const noslip_course_tracker_options_f *options)
{
    noslip_course_tracker_options_f *own;
    int status;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (course == NULL || options == NULL) {
        return NOSLIP_NULL;
    }
    if (course->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_course_tracker_ok_f(options)) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->course = course;
    own = &self->options; /* by members: an assignment may call memcpy */
    own->speed = options->speed;
    own->deceleration = options->deceleration;
    own->creep = options->creep > 0 ? options->creep : (float)0.01;
    own->window = options->window;
    own->start = options->start;
    own->L[0] = options->L[0];
    own->L[1] = options->L[1];
    own->W = options->W;
    own->ahead = options->ahead;
    own->reversing = options->reversing;
    own->stop = options->stop;
    own->endless = options->endless;
    self->now.first = 0;
    self->now.last = noslip_course_last_f(course, 0);
    self->now.piece = 0;
    self->now.stopped = 0;
    self->now.length = options->start;
    self->started = 0;
    status = noslip_course_pieces_f(self);
    self->ready = status == NOSLIP_OK ? NOSLIP_READY : 0;
    return status;
}

/*
 * Computes the guide at a pose of the vehicle's point (m, rad) and a forward speed (m/s), on the piece that is followed; the tracker
 * does not change. Returns and errors as for noslip_course_tracker_update.
 */
NOSLIP_NODISCARD static inline int noslip_course_tracker_look_f(const noslip_course_tracker_f *self,
                                                     float x, float y, float heading,
                                                     float forward_speed,
                                                     noslip_course_guide_f *guide)
{
    noslip_course_place_on_f now;
    float pose[4];
    int status;
    if (self == NULL || guide == NULL) {
        return NOSLIP_NULL;
    }
    status = noslip_course_pose_f(self, x, y, heading, forward_speed, pose);
    if (status == NOSLIP_OK) {
        now = self->now;
        status = noslip_course_advance_f(self, pose, forward_speed, 0, &now);
    }
    return status != NOSLIP_OK ? status : noslip_course_guided_f(self, pose, forward_speed, &now, guide);
}

/*
 * Goes on to the next piece where the vehicle stands at a cusp, and computes the guide. Call it before every step of the law.
 * Returns NOSLIP_ARRIVED once the end is reached. On an error neither the tracker nor the guide changes: NOSLIP_NULL,
 * NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_RANGE, NOSLIP_SINGULAR if P_l is as far from the piece as the centre of its curvature,
 * or its nearest point outside the window.
 */
NOSLIP_NODISCARD static inline int noslip_course_tracker_update_f(noslip_course_tracker_f *self, float x,
                                                 float y, float heading,
                                                 float forward_speed,
                                                 noslip_course_guide_f *guide)
{
    noslip_course_place_on_f now;
    float pose[4];
    int status;
    if (self == NULL || guide == NULL) {
        return NOSLIP_NULL;
    }
    status = noslip_course_pose_f(self, x, y, heading, forward_speed, pose);
    if (status != NOSLIP_OK) {
        return status;
    }
    now = self->now;
    status = noslip_course_advance_f(self, pose, forward_speed, 1, &now);
    if (status == NOSLIP_OK) {
        status = noslip_course_guided_f(self, pose, forward_speed, &now, guide);
    }
    if (status >= 0) {
        self->now = now;
        self->started = NOSLIP_READY;
    }
    return status;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
