/*
 * noslip_profile.h - the fastest speed along a composite path for given accelerations.
 *
 * noslip_path.h keeps one speed up to the next stop, also where an arc begins. A profile limits it: the lateral acceleration on an
 * arc, v^2 / radius of the middle of the axle, and the acceleration along the path are together within an ellipse, as the force of
 * a wheel is within a circle of friction:
 *
 *     (lateral / limits.lateral)^2 + (forward / limits.acceleration)^2 <= 1, and likewise with limits.deceleration
 *
 * At a join, where the curvature jumps, the vehicle also has to begin to turn: limits.angular, rad/s^2, bounds the change of its
 * yaw rate there. It is the fastest one within these limits: a pass from the end to the start brakes in time, a pass from the start to the end
 * accelerates, each exact on lines and arcs (a straight line, or a sine, of v^2 over the way). The lateral acceleration is that of
 * a vehicle that turns with the curvature of the path; after a join it does so within a way of about the lookahead.
 *
 *     static float squares[COUNT];
 *     noslip_path_init_f(&path, segments, COUNT, &options, NULL);          options.speed: the largest anywhere
 *     noslip_profile_init_f(&profile, segments, COUNT, &options, &limits, squares);
 *
 * At each call, after noslip_path_step:
 *
 *     noslip_profile_speed_f(&profile, &path.guide, forward_speed, &reference.speed, &reference.speed_rate);
 *
 * On a closed path the profile is that of the laps after the first one; begin the first one with noslip_approach.h.
 * noslip_profile_speed computes at most two sines, two arctangents and five square roots, whatever the number of segments.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_PROFILE_H
#define NOSLIP_PROFILE_H

#include "noslip_path.h"

/* -- double: generated from noslip_profile.inc by guarantees/headers.py ------------------------------------------------ */

/* Largest accelerations, m/s^2, all positive; together they are within an ellipse. And that of the yaw rate. */
typedef struct noslip_profile_limits {
    double lateral;           /* towards the centre of the curve */
    double acceleration;      /* forward */
    double deceleration;      /* braking; that of the path's options too, so that its own braking is the same */
    double angular;           /* rad/s^2: of the vehicle where the curvature jumps, at joins; 0: no limit */
} noslip_profile_limits;

/* A profile: initialized by init, owned by the caller, who does not write to it. */
typedef struct noslip_profile {
    const noslip_segment *segments;
    double *squares;      /* m^2/s^2: of the speed where each segment starts; negative: less the m from there to where it is 0 */
    int count, closed;
    noslip_profile_limits limits;
    double most;              /* m^2/s^2 */
    double creep;             /* m/s */
    double lookahead[2];      /* m: of P_l ahead of the axle, driving forward [0] and in reverse [1] */
    double W;                 /* m */
    double extension[2];      /* m: length of the extension at the end of a run, as of the path */
    int stop;                 /* NOSLIP_STOP_POINT or NOSLIP_STOP_AXLE */
    int ready;
} noslip_profile;

/* What limits the speed on a segment. */
typedef struct noslip_bend {
    double square;      /* m^2/s^2: largest speed */
    double turn;        /* m^2/s^2: the speed whose lateral acceleration is the limit; the largest number on a line */
    double ratio;       /* way of the middle of the axle over that of P_l, their radii */
} noslip_bend;

/* Computes the limits on a segment. On an arc, P_l and the middle of the axle go on circles about the same centre. */
static inline noslip_bend noslip_bend_of(const noslip_profile *self, int segment)
{
    const noslip_segment *given = &self->segments[segment];
    const int backward = given->backward != 0;
    const double lookahead = self->lookahead[backward];
    const double inward = (given->curvature > 0) == (backward == 0) ? self->W : -self->W;
    const double curvature = noslip_abs(given->curvature), part = curvature * lookahead;
    const double of_axle = inward * curvature + noslip_sqrt((1 - part) * (1 + part));                   /* in radii */
    noslip_bend bend = {0, DBL_MAX, 1};
    if (curvature > self->limits.lateral / DBL_MAX * 2 && of_axle > 0) {
        bend.ratio = of_axle;
        bend.turn = self->limits.lateral / curvature * of_axle;
    }
    bend.square = bend.turn < self->most ? bend.turn : self->most;
    return bend;
}

/* Returns the square of the speed (m^2/s^2) at which the vehicle, turning with one segment, begins to turn with the next one at the
 * angular limit: the yaw rate changes by v^2 (change of curvature) / (lookahead ratio^3). */
static inline double noslip_square_at_join(const noslip_profile *self, int before, int after)
{
    const noslip_bend one = noslip_bend_of(self, before);
    const noslip_bend other = noslip_bend_of(self, after);
    const double least = one.square < other.square ? one.square : other.square;
    const double change = noslip_abs(self->segments[after].curvature - self->segments[before].curvature);
    const double lookahead = noslip_abs(self->lookahead[self->segments[after].backward != 0]);
    const double most = self->limits.angular * lookahead * one.ratio * one.ratio * one.ratio;
    return most > 0 && most < least * change ? most / change : least;
}

/*
 * Computes the square of the speed (m^2/s^2) after P_l has moved on by `way` (m) from one with `square`, changing at most by
 * `acceleration` (m/s^2) as far as the bend leaves it. There sin(angle) = square / turn, and the angle grows evenly with the way.
 */
static inline double noslip_square_after(const noslip_bend *bend, double square,
                       double way, double acceleration)
{
    const double gain = 2 * acceleration * bend->ratio * way;
    double part, angle, sine, cosine, after = square + gain;
    if (bend->turn < DBL_MAX) {
        part = square / bend->turn;
        part = part < 1 ? part : 1;
        angle = noslip_angle_of(part, noslip_sqrt((1 - part) * (1 + part)), 1) + gain / bend->turn;
        if (!(angle < (double)1.5707963)) {
            return bend->square;
        }
        noslip_sincos(angle, &sine, &cosine);
        after = bend->turn * sine;
    }
    return after < bend->square ? after : bend->square;
}

/* Returns 1 if a run ends with this segment. */
static inline int noslip_run_ends(const noslip_profile *self, int segment)
{
    const int next = segment + 1 < self->count ? segment + 1 : self->closed ? 0 : -1;
    return next < 0 || (self->segments[next].backward != 0) != (self->segments[segment].backward != 0);
}

/* Returns the square of the speed with which a segment may end. */
static inline double noslip_square_at_end(const noslip_profile *self, int segment)
{
    double square;
    if (noslip_run_ends(self, segment)) {
        square = 2 * self->limits.deceleration * self->extension[self->segments[segment].backward != 0];
    } else {
        square = self->squares[segment + 1 < self->count ? segment + 1 : 0];
    }
    return square > 0 ? square : 0;
}

/* Returns how far P_l is on a run when the vehicle starts from rest (m): after a cusp it has changed sides. */
static inline double noslip_run_start(const noslip_profile *self, int segment)
{
    const double ahead = noslip_abs(self->lookahead[0]), behind = noslip_abs(self->lookahead[1]);
    if (self->stop == NOSLIP_STOP_AXLE) {
        return self->segments[segment].backward != 0 ? behind : ahead;
    }
    return segment > 0 || self->closed ? ahead + behind : 0;
}

/* Lowers the squares so that the vehicle can brake in time, from the end to the start. */
static inline void noslip_profile_backward(noslip_profile *self)
{
    int k;
    for (k = self->count - 1; k >= 0; k--) {
        const noslip_bend bend = noslip_bend_of(self, k);
        const double square = noslip_square_after(&bend, noslip_square_at_end(self, k),
                                                                    self->segments[k].length, self->limits.deceleration);
        self->squares[k] = square < self->squares[k] ? square : self->squares[k];
    }
}

/* Lowers the squares to what the acceleration reaches, from the start to the end. */
static inline void noslip_profile_forward(noslip_profile *self)
{
    int k;
    for (k = 0; k < self->count; k++) {
        const int next = k + 1 < self->count ? k + 1 : 0;
        const double rest = self->squares[k] < 0 ? -self->squares[k] : 0, way = self->segments[k].length - rest;
        if (noslip_run_ends(self, k)) {
            if (next > 0 || self->closed) {
                self->squares[next] = -noslip_run_start(self, next);
            }
        } else if (way < 0) {
            self->squares[next] = way;
        } else {
            const noslip_bend bend = noslip_bend_of(self, k);
            const double from = rest > 0 ? 0 : self->squares[k];
            const double square = noslip_square_after(&bend, from, way, self->limits.acceleration);
            self->squares[next] = square < self->squares[next] ? square : self->squares[next];
        }
    }
}

/*
 * Initializes a profile of a path that noslip_path_init has accepted with the same segments and options. `squares` is memory for
 * `count` numbers; neither array is copied. The cost is linear in the number of segments. Returns NOSLIP_BAD_PARAMETER unless the
 * limits are finite and positive and count is positive.
 */
static inline int noslip_profile_init(noslip_profile *self,
                         const noslip_segment *segments, int count,
                         const noslip_path_options *options,
                         const noslip_profile_limits *limits, double *squares)
{
    int k, lap;
    if (self != NULL) {
        self->ready = 0;
    }
    if (self == NULL || segments == NULL || options == NULL || limits == NULL || squares == NULL) {
        return NOSLIP_NULL;
    }
    if (!(count > 0 && noslip_is_positive(limits->lateral) &&
          noslip_is_positive(limits->acceleration) && noslip_is_positive(limits->deceleration) &&
          noslip_is_finite(limits->angular) && limits->angular >= 0 &&
          noslip_is_positive(options->speed * options->speed))) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->segments = segments;
    self->squares = squares;
    self->count = count;
    self->closed = options->closed != 0;
    self->limits = *limits;
    self->most = options->speed * options->speed;
    self->creep = options->creep > 0 ? options->creep : (double)0.01;
    self->creep = self->creep < options->speed ? self->creep : options->speed;
    self->W = options->W;
    self->stop = options->stop;
    for (k = 0; k < 2; k++) {
        self->lookahead[k] = options->L[k] + options->ahead;
        self->extension[k] = options->stop == NOSLIP_STOP_AXLE ? noslip_abs(self->lookahead[k]) : 0;
    }
    squares[0] = self->closed ? noslip_square_at_join(self, count - 1, 0) : self->most;
    for (k = 1; k < count; k++) {
        squares[k] = noslip_square_at_join(self, k - 1, k);
    }
    for (lap = 0; lap <= self->closed; lap++) {
        noslip_profile_backward(self);
    }
    if (!self->closed) {
        squares[0] = -noslip_run_start(self, 0);
    }
    for (lap = 0; lap <= self->closed; lap++) {
        noslip_profile_forward(self);
    }
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* Computes what noslip_profile_speed does, where the arguments are in order. */
static inline void noslip_profile_at(const noslip_profile *self, const noslip_guide *guide,
           double forward_speed, double *speed, double *speed_rate)
{
    const noslip_segment *given = &self->segments[guide->segment];
    noslip_bend bend;
    double start, on, square, after, rate, part, direction, fastest, share;
    *speed = guide->speed;
    *speed_rate = guide->speed_rate;
    if (noslip_abs(guide->x - given->x) > 0 || noslip_abs(guide->y - given->y) > 0 ||
        noslip_abs(guide->curvature - given->curvature) > 0) {
        return; /* on the straight extension of a run */
    }
    bend = noslip_bend_of(self, guide->segment);
    start = self->squares[guide->segment];
    on = guide->progress < 0 ? 0 : guide->progress < given->length ? guide->progress : given->length;
    square = noslip_square_after(&bend, noslip_square_at_end(self, guide->segment),
                                              given->length - on, self->limits.deceleration);
    rate = square < bend.square ? -self->limits.deceleration : 0;
    on = start < 0 ? on + start : on;
    after = on > 0 ? noslip_square_after(&bend, start > 0 ? start : 0, on, self->limits.acceleration)
                   : start > 0 ? start : 0;
    if (after < square) {
        square = after;
        rate = self->limits.acceleration;
    }
    part = square < bend.turn ? square / bend.turn : 1;
    rate *= noslip_sqrt((1 - part) * (1 + part));
    fastest = noslip_sqrt(square);
    if (!(fastest > self->creep)) {
        fastest = self->creep;
        rate = 0;
    }
    if (fastest < noslip_abs(guide->speed)) {
        direction = guide->speed < 0 ? -1 : 1;
        share = direction * forward_speed / fastest; /* the place moves with the vehicle */
        share = share > 2 ? 2 : share > 0 ? share : 0;
        *speed = direction * fastest;
        *speed_rate = direction * rate * share;
    }
}

/*
 * Computes the desired forward speed (m/s, negative in reverse) at the place on the path that `guide` says, at most that of the
 * guide, and its rate along the motion with `forward_speed` (m/s^2). Beyond the end of a run, and at a stop, both are the guide's.
 * Returns NOSLIP_NONFINITE if progress, forward_speed or a result is not finite; then both are zero.
 */
static inline int noslip_profile_speed(const noslip_profile *self,
                          const noslip_guide *guide, double forward_speed,
                          double *speed, double *speed_rate)
{
    double desired = 0, rate = 0;
    int status = NOSLIP_OK;
    if (speed == NULL || speed_rate == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || guide == NULL) {
        status = NOSLIP_NULL;
    } else if (self->ready != NOSLIP_READY || guide->segment < 0 || guide->segment >= self->count) {
        status = NOSLIP_NOT_READY;
    } else if (!(noslip_is_finite(guide->progress) && noslip_is_finite(forward_speed))) {
        status = NOSLIP_NONFINITE;
    } else {
        noslip_profile_at(self, guide, forward_speed, &desired, &rate);
        status = noslip_is_finite(desired) && noslip_is_finite(rate) ? NOSLIP_OK : NOSLIP_NONFINITE;
    }
    *speed = status == NOSLIP_OK ? desired : 0;
    *speed_rate = status == NOSLIP_OK ? rate : 0;
    return status;
}

/* -- float: generated from noslip_profile.inc by guarantees/headers.py ------------------------------------------------- */

/* Largest accelerations, m/s^2, all positive; together they are within an ellipse. And that of the yaw rate. */
typedef struct noslip_profile_limits_f {
    float lateral;            /* towards the centre of the curve */
    float acceleration;       /* forward */
    float deceleration;       /* braking; that of the path's options too, so that its own braking is the same */
    float angular;            /* rad/s^2: of the vehicle where the curvature jumps, at joins; 0: no limit */
} noslip_profile_limits_f;

/* A profile: initialized by init, owned by the caller, who does not write to it. */
typedef struct noslip_profile_f {
    const noslip_segment_f *segments;
    float *squares;       /* m^2/s^2: of the speed where each segment starts; negative: less the m from there to where it is 0 */
    int count, closed;
    noslip_profile_limits_f limits;
    float most;               /* m^2/s^2 */
    float creep;              /* m/s */
    float lookahead[2];       /* m: of P_l ahead of the axle, driving forward [0] and in reverse [1] */
    float W;                  /* m */
    float extension[2];       /* m: length of the extension at the end of a run, as of the path */
    int stop;                 /* NOSLIP_STOP_POINT or NOSLIP_STOP_AXLE */
    int ready;
} noslip_profile_f;

/* What limits the speed on a segment. */
typedef struct noslip_bend_f {
    float square;       /* m^2/s^2: largest speed */
    float turn;         /* m^2/s^2: the speed whose lateral acceleration is the limit; the largest number on a line */
    float ratio;        /* way of the middle of the axle over that of P_l, their radii */
} noslip_bend_f;

/* Computes the limits on a segment. On an arc, P_l and the middle of the axle go on circles about the same centre. */
static inline noslip_bend_f noslip_bend_of_f(const noslip_profile_f *self, int segment)
{
    const noslip_segment_f *given = &self->segments[segment];
    const int backward = given->backward != 0;
    const float lookahead = self->lookahead[backward];
    const float inward = (given->curvature > 0) == (backward == 0) ? self->W : -self->W;
    const float curvature = noslip_abs_f(given->curvature), part = curvature * lookahead;
    const float of_axle = inward * curvature + noslip_sqrt_f((1 - part) * (1 + part));                  /* in radii */
    noslip_bend_f bend = {0, FLT_MAX, 1};
    if (curvature > self->limits.lateral / FLT_MAX * 2 && of_axle > 0) {
        bend.ratio = of_axle;
        bend.turn = self->limits.lateral / curvature * of_axle;
    }
    bend.square = bend.turn < self->most ? bend.turn : self->most;
    return bend;
}

/* Returns the square of the speed (m^2/s^2) at which the vehicle, turning with one segment, begins to turn with the next one at the
 * angular limit: the yaw rate changes by v^2 (change of curvature) / (lookahead ratio^3). */
static inline float noslip_square_at_join_f(const noslip_profile_f *self, int before, int after)
{
    const noslip_bend_f one = noslip_bend_of_f(self, before);
    const noslip_bend_f other = noslip_bend_of_f(self, after);
    const float least = one.square < other.square ? one.square : other.square;
    const float change = noslip_abs_f(self->segments[after].curvature - self->segments[before].curvature);
    const float lookahead = noslip_abs_f(self->lookahead[self->segments[after].backward != 0]);
    const float most = self->limits.angular * lookahead * one.ratio * one.ratio * one.ratio;
    return most > 0 && most < least * change ? most / change : least;
}

/*
 * Computes the square of the speed (m^2/s^2) after P_l has moved on by `way` (m) from one with `square`, changing at most by
 * `acceleration` (m/s^2) as far as the bend leaves it. There sin(angle) = square / turn, and the angle grows evenly with the way.
 */
static inline float noslip_square_after_f(const noslip_bend_f *bend, float square,
                         float way, float acceleration)
{
    const float gain = 2 * acceleration * bend->ratio * way;
    float part, angle, sine, cosine, after = square + gain;
    if (bend->turn < FLT_MAX) {
        part = square / bend->turn;
        part = part < 1 ? part : 1;
        angle = noslip_angle_of_f(part, noslip_sqrt_f((1 - part) * (1 + part)), 1) + gain / bend->turn;
        if (!(angle < (float)1.5707963)) {
            return bend->square;
        }
        noslip_sincos_f(angle, &sine, &cosine);
        after = bend->turn * sine;
    }
    return after < bend->square ? after : bend->square;
}

/* Returns 1 if a run ends with this segment. */
static inline int noslip_run_ends_f(const noslip_profile_f *self, int segment)
{
    const int next = segment + 1 < self->count ? segment + 1 : self->closed ? 0 : -1;
    return next < 0 || (self->segments[next].backward != 0) != (self->segments[segment].backward != 0);
}

/* Returns the square of the speed with which a segment may end. */
static inline float noslip_square_at_end_f(const noslip_profile_f *self, int segment)
{
    float square;
    if (noslip_run_ends_f(self, segment)) {
        square = 2 * self->limits.deceleration * self->extension[self->segments[segment].backward != 0];
    } else {
        square = self->squares[segment + 1 < self->count ? segment + 1 : 0];
    }
    return square > 0 ? square : 0;
}

/* Returns how far P_l is on a run when the vehicle starts from rest (m): after a cusp it has changed sides. */
static inline float noslip_run_start_f(const noslip_profile_f *self, int segment)
{
    const float ahead = noslip_abs_f(self->lookahead[0]), behind = noslip_abs_f(self->lookahead[1]);
    if (self->stop == NOSLIP_STOP_AXLE) {
        return self->segments[segment].backward != 0 ? behind : ahead;
    }
    return segment > 0 || self->closed ? ahead + behind : 0;
}

/* Lowers the squares so that the vehicle can brake in time, from the end to the start. */
static inline void noslip_profile_backward_f(noslip_profile_f *self)
{
    int k;
    for (k = self->count - 1; k >= 0; k--) {
        const noslip_bend_f bend = noslip_bend_of_f(self, k);
        const float square = noslip_square_after_f(&bend, noslip_square_at_end_f(self, k),
                                                                    self->segments[k].length, self->limits.deceleration);
        self->squares[k] = square < self->squares[k] ? square : self->squares[k];
    }
}

/* Lowers the squares to what the acceleration reaches, from the start to the end. */
static inline void noslip_profile_forward_f(noslip_profile_f *self)
{
    int k;
    for (k = 0; k < self->count; k++) {
        const int next = k + 1 < self->count ? k + 1 : 0;
        const float rest = self->squares[k] < 0 ? -self->squares[k] : 0, way = self->segments[k].length - rest;
        if (noslip_run_ends_f(self, k)) {
            if (next > 0 || self->closed) {
                self->squares[next] = -noslip_run_start_f(self, next);
            }
        } else if (way < 0) {
            self->squares[next] = way;
        } else {
            const noslip_bend_f bend = noslip_bend_of_f(self, k);
            const float from = rest > 0 ? 0 : self->squares[k];
            const float square = noslip_square_after_f(&bend, from, way, self->limits.acceleration);
            self->squares[next] = square < self->squares[next] ? square : self->squares[next];
        }
    }
}

/*
 * Initializes a profile of a path that noslip_path_init has accepted with the same segments and options. `squares` is memory for
 * `count` numbers; neither array is copied. The cost is linear in the number of segments. Returns NOSLIP_BAD_PARAMETER unless the
 * limits are finite and positive and count is positive.
 */
static inline int noslip_profile_init_f(noslip_profile_f *self,
                             const noslip_segment_f *segments, int count,
                             const noslip_path_options_f *options,
                             const noslip_profile_limits_f *limits, float *squares)
{
    int k, lap;
    if (self != NULL) {
        self->ready = 0;
    }
    if (self == NULL || segments == NULL || options == NULL || limits == NULL || squares == NULL) {
        return NOSLIP_NULL;
    }
    if (!(count > 0 && noslip_is_positive_f(limits->lateral) &&
          noslip_is_positive_f(limits->acceleration) && noslip_is_positive_f(limits->deceleration) &&
          noslip_is_finite_f(limits->angular) && limits->angular >= 0 &&
          noslip_is_positive_f(options->speed * options->speed))) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->segments = segments;
    self->squares = squares;
    self->count = count;
    self->closed = options->closed != 0;
    self->limits = *limits;
    self->most = options->speed * options->speed;
    self->creep = options->creep > 0 ? options->creep : (float)0.01;
    self->creep = self->creep < options->speed ? self->creep : options->speed;
    self->W = options->W;
    self->stop = options->stop;
    for (k = 0; k < 2; k++) {
        self->lookahead[k] = options->L[k] + options->ahead;
        self->extension[k] = options->stop == NOSLIP_STOP_AXLE ? noslip_abs_f(self->lookahead[k]) : 0;
    }
    squares[0] = self->closed ? noslip_square_at_join_f(self, count - 1, 0) : self->most;
    for (k = 1; k < count; k++) {
        squares[k] = noslip_square_at_join_f(self, k - 1, k);
    }
    for (lap = 0; lap <= self->closed; lap++) {
        noslip_profile_backward_f(self);
    }
    if (!self->closed) {
        squares[0] = -noslip_run_start_f(self, 0);
    }
    for (lap = 0; lap <= self->closed; lap++) {
        noslip_profile_forward_f(self);
    }
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* Computes what noslip_profile_speed does, where the arguments are in order. */
static inline void noslip_profile_at_f(const noslip_profile_f *self, const noslip_guide_f *guide,
                 float forward_speed, float *speed, float *speed_rate)
{
    const noslip_segment_f *given = &self->segments[guide->segment];
    noslip_bend_f bend;
    float start, on, square, after, rate, part, direction, fastest, share;
    *speed = guide->speed;
    *speed_rate = guide->speed_rate;
    if (noslip_abs_f(guide->x - given->x) > 0 || noslip_abs_f(guide->y - given->y) > 0 ||
        noslip_abs_f(guide->curvature - given->curvature) > 0) {
        return; /* on the straight extension of a run */
    }
    bend = noslip_bend_of_f(self, guide->segment);
    start = self->squares[guide->segment];
    on = guide->progress < 0 ? 0 : guide->progress < given->length ? guide->progress : given->length;
    square = noslip_square_after_f(&bend, noslip_square_at_end_f(self, guide->segment),
                                              given->length - on, self->limits.deceleration);
    rate = square < bend.square ? -self->limits.deceleration : 0;
    on = start < 0 ? on + start : on;
    after = on > 0 ? noslip_square_after_f(&bend, start > 0 ? start : 0, on, self->limits.acceleration)
                   : start > 0 ? start : 0;
    if (after < square) {
        square = after;
        rate = self->limits.acceleration;
    }
    part = square < bend.turn ? square / bend.turn : 1;
    rate *= noslip_sqrt_f((1 - part) * (1 + part));
    fastest = noslip_sqrt_f(square);
    if (!(fastest > self->creep)) {
        fastest = self->creep;
        rate = 0;
    }
    if (fastest < noslip_abs_f(guide->speed)) {
        direction = guide->speed < 0 ? -1 : 1;
        share = direction * forward_speed / fastest; /* the place moves with the vehicle */
        share = share > 2 ? 2 : share > 0 ? share : 0;
        *speed = direction * fastest;
        *speed_rate = direction * rate * share;
    }
}

/*
 * Computes the desired forward speed (m/s, negative in reverse) at the place on the path that `guide` says, at most that of the
 * guide, and its rate along the motion with `forward_speed` (m/s^2). Beyond the end of a run, and at a stop, both are the guide's.
 * Returns NOSLIP_NONFINITE if progress, forward_speed or a result is not finite; then both are zero.
 */
static inline int noslip_profile_speed_f(const noslip_profile_f *self,
                              const noslip_guide_f *guide, float forward_speed,
                              float *speed, float *speed_rate)
{
    float desired = 0, rate = 0;
    int status = NOSLIP_OK;
    if (speed == NULL || speed_rate == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || guide == NULL) {
        status = NOSLIP_NULL;
    } else if (self->ready != NOSLIP_READY || guide->segment < 0 || guide->segment >= self->count) {
        status = NOSLIP_NOT_READY;
    } else if (!(noslip_is_finite_f(guide->progress) && noslip_is_finite_f(forward_speed))) {
        status = NOSLIP_NONFINITE;
    } else {
        noslip_profile_at_f(self, guide, forward_speed, &desired, &rate);
        status = noslip_is_finite_f(desired) && noslip_is_finite_f(rate) ? NOSLIP_OK : NOSLIP_NONFINITE;
    }
    *speed = status == NOSLIP_OK ? desired : 0;
    *speed_rate = status == NOSLIP_OK ? rate : 0;
    return status;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
