/*
 * noslip_approach.h - a reference that leads the vehicle to its path with bounded acceleration.
 *
 * Without it a law of path following wants the distance to be 0 at once, and asks for more than wheels can hold when it starts
 * beside the path. The generator leads the desired distance from where the vehicle is to 0: as fast as the acceleration permits, the
 * last part linear so that it does not chatter (Han's discrete time-optimal law with a linear zone, IEEE Trans. Industrial
 * Electronics 56(3), 2009); and the desired speed from the present speed. At the start, and after each correction of the pose:
 *
 *     noslip_approach_init(&approach, 0.5, 0.25, 0);
 *     noslip_approach_start(&approach, y[0], ydot[0], y[1]);      from the law's functions output and rate
 *
 * At each call of the controller, dt after the last:
 *
 *     noslip_approach_step(&approach, dt, 1.4, &wanted);
 *     reference.distance = wanted.distance;                       and the other fields, which have the same names
 *
 * On a composite path (noslip_path.h) the final speed is guide.speed, the reference of the law after
 *
 *     noslip_approach_within(&approach, guide.speed, guide.speed_rate, &wanted);
 *
 * and noslip_approach_start is called again where guide.L changes. For a point in the plane, or a heading, one generator leads each
 * output y: start with y - y_d and its rate, and add distance, its rate and acceleration to y_d and its derivatives. Of a point,
 * each coordinate may have the acceleration divided by sqrt(2).
 *
 * With a jerk in init the acceleration changes gradually. The distance then follows the fastest way that both bounds permit, from
 * its rate at the start (and no acceleration) to rest at 0; start finds it, by 64 halvings of an interval with four roots each. The
 * desired speed goes to the final one with both bounds; noslip_approach_within keeps the speed of a path, whose jerk is its own.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_APPROACH_H
#define NOSLIP_APPROACH_H

#include "noslip_controller.h"

#define NOSLIP_HALVINGS 64 /* of an interval of rates; the last ones do not change it any more */

/* -- double: generated from noslip_approach.inc by guarantees/headers.py ----------------------------------------------- */

/* Desired distance and speed with their derivatives, as in the reference of a law of path following. */
typedef struct noslip_approached {
    double distance, distance_rate, distance_acceleration;      /* m, m/s, m/s^2 */
    double speed, speed_rate;                                   /* m/s, m/s^2 */
} noslip_approached;

/* A way to distance 0 with bounded jerk: two changes of the rate, each with its largest acceleration in the middle. */
typedef struct noslip_approach_plan {
    double side;                 /* 1 or -1: times the distance, the rate between the changes is positive */
    double distance, rate;       /* at its start, times side; not positive where it would stop at once */
    double first, second;        /* m/s: size of the change to the rate between, and to 0 */
    double until, duration;      /* s: end of the first change, and of the second */
    double time;                 /* s: since its start */
} noslip_approach_plan;

/* A reference generator: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct noslip_approach {
    double acceleration;                  /* m/s^2: largest */
    double settling;                      /* s: time constant of the end */
    double jerk;                          /* m/s^3: largest; 0: no bound */
    noslip_approach_plan plan;              /* with a jerk */
    noslip_approached desired;              /* of the last step */
    int ready;
} noslip_approach;

/* Copies member by member: a compiler may call memcpy for a whole struct. */
static inline void noslip_approach_copy(const noslip_approached *from, noslip_approached *to)
{
    to->distance = from->distance;
    to->distance_rate = from->distance_rate;
    to->distance_acceleration = from->distance_acceleration;
    to->speed = from->speed;
    to->speed_rate = from->speed_rate;
}

/*
 * Initializes with the largest acceleration of distance and of speed (m/s^2), and the time constant `settling` (s) with which the
 * distance ends. With a `jerk` (m/s^3; 0: none) the change of the acceleration is bounded too. Returns NOSLIP_BAD_PARAMETER unless
 * all are finite, the first two positive and jerk not negative.
 */
NOSLIP_NODISCARD static inline int noslip_approach_init(noslip_approach *self, double acceleration,
                     double settling, double jerk)
{
    static const noslip_approached zero = {0, 0, 0, 0, 0};
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (!(noslip_is_positive(acceleration) && noslip_is_positive(settling) &&
          noslip_is_positive(acceleration * settling * settling) && noslip_is_finite(jerk) &&
          (!(jerk > 0 || jerk < 0) || (noslip_is_positive(jerk * settling * settling) &&
                                       noslip_is_positive(acceleration / jerk))))) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->acceleration = acceleration;
    self->settling = settling;
    self->jerk = jerk;
    self->plan.side = 1; /* at the end of a plan, until start */
    self->plan.until = self->plan.duration = self->plan.time = 0;
    noslip_approach_copy(&zero, &self->desired);
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* How a rate changes from rest to `size` (m/s): with bounded jerk up to its largest acceleration and back, as fast as possible. */
typedef struct noslip_rise {
    double jerk, size;      /* m/s^3, m/s */
    double bend, hold;      /* s: in which the acceleration rises, and in which it stays */
} noslip_rise;

/* Returns the fastest change of a rate by `size`, not negative. */
static inline noslip_rise noslip_rise_of(const noslip_approach *self, double size)
{
    const double most = self->acceleration / self->jerk, bend = noslip_sqrt(size / self->jerk);
    noslip_rise rise;
    rise.jerk = self->jerk;
    rise.size = size;
    rise.bend = bend < most ? bend : most;
    rise.hold = bend < most ? 0 : size / self->acceleration - most;
    return rise;
}

/* Returns how long a change takes, s. */
static inline double noslip_rise_time(const noslip_rise *rise)
{
    return 2 * rise->bend + rise->hold;
}

/* Computes way (m), rate and acceleration at a time (s) of a change from rest, which is within it. */
static inline void noslip_rise_at(const noslip_rise *rise, double time, double at[3])
{
    const double duration = noslip_rise_time(rise), left = duration - time;
    const double bend = time < rise->bend ? time : left < rise->bend ? left : rise->bend;
    const double acceleration = rise->jerk * bend, rate = acceleration * bend / 2, way = rate * bend / 3;
    if (left < rise->bend && !(time < rise->bend)) { /* the end is the start in reverse */
        at[0] = rise->size * (duration / 2 - left) + way;
        at[1] = rise->size - rate;
    } else {
        const double since = time - bend;
        at[0] = way + since * (rate + since * acceleration / 2);
        at[1] = rate + since * acceleration;
    }
    at[2] = acceleration;
}

/* Returns the distance (m) at which a plan with a rate of `peak` (m/s) between its changes ends. */
static inline double noslip_plan_end(const noslip_approach *self,
                        const noslip_approach_plan *plan, double peak)
{
    const noslip_rise first = noslip_rise_of(self, peak - plan->rate);
    const noslip_rise second = noslip_rise_of(self, peak);
    return plan->distance + (plan->rate + peak) / 2 * noslip_rise_time(&first) +
           peak / 2 * noslip_rise_time(&second);
}

/*
 * Computes the fastest plan from a distance and its rate, without acceleration, to 0. The rate between its changes is where the
 * end, which grows with that rate, is 0: by bisection between the rates at which it is before and beyond.
 */
static inline void noslip_plan_of(const noslip_approach *self, double distance, double rate,
           noslip_approach_plan *plan)
{
    const noslip_rise stop = noslip_rise_of(self, noslip_abs(rate));
    const double rest = distance + rate / 2 * noslip_rise_time(&stop);
    noslip_rise first, second;
    double low, high;
    int i;
    plan->side = rest > 0 ? -1 : 1;
    plan->distance = plan->side * distance;
    plan->rate = plan->side * rate;
    low = plan->rate > 0 ? plan->rate : 0;
    high = low + noslip_sqrt(2 * self->acceleration * noslip_abs(rest));
    for (i = 0; i < NOSLIP_HALVINGS; i++) {
        const double middle = low + (high - low) / 2;
        if (noslip_plan_end(self, plan, middle) < 0) {
            low = middle;
        } else {
            high = middle;
        }
    }
    plan->first = high - plan->rate;
    plan->second = high;
    first = noslip_rise_of(self, plan->first);
    second = noslip_rise_of(self, plan->second);
    plan->until = noslip_rise_time(&first);
    plan->duration = plan->until + noslip_rise_time(&second);
    plan->time = 0;
}

/* Computes distance, rate and acceleration at a time (s) of the plan. The second change is one from rest in reverse. */
static inline void noslip_plan_at(const noslip_approach *self, double time,
                noslip_approached *desired)
{
    const noslip_approach_plan *plan = &self->plan;
    const double left = plan->duration - time;
    double at[3];
    if (time < plan->until) {
        const noslip_rise rise = noslip_rise_of(self, plan->first);
        noslip_rise_at(&rise, time, at);
        at[0] += plan->distance + plan->rate * time;
        at[1] += plan->rate;
    } else if (left > 0) {
        const noslip_rise rise = noslip_rise_of(self, plan->second);
        noslip_rise_at(&rise, left, at);
        at[0] = -at[0];
        at[2] = -at[2];
    } else {
        at[0] = at[1] = at[2] = 0;
    }
    desired->distance = plan->side * at[0];
    desired->distance_rate = plan->side * at[1];
    desired->distance_acceleration = plan->side * at[2];
}

/*
 * Begins where the vehicle is: with its distance from the path (m), the rate of that (m/s) and its speed (m/s). To be called before
 * the first step, and again after the pose was corrected or the path changed. Returns NOSLIP_NONFINITE if one is not finite.
 */
static inline int noslip_approach_start(noslip_approach *self, double distance,
                      double distance_rate, double speed)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!(noslip_is_finite(distance) && noslip_is_finite(distance_rate) &&
        noslip_is_finite(speed))) {
        return NOSLIP_NONFINITE;
    }
    if (self->jerk > 0) {
        noslip_approach_plan plan;
        noslip_plan_of(self, distance, distance_rate, &plan);
        if (!(noslip_is_finite(plan.first + plan.second) && noslip_is_finite(plan.duration))) {
            return NOSLIP_NONFINITE;
        }
        noslip_copy(&self->plan, &plan, sizeof plan);
    }
    self->desired.distance = distance;
    self->desired.distance_rate = distance_rate;
    self->desired.distance_acceleration = 0;
    self->desired.speed = speed;
    self->desired.speed_rate = 0;
    return NOSLIP_OK;
}

/* Returns the acceleration, at most `most`, from a distance and its rate to 0, time-optimal up to a zone of size most settling^2 where
 * it is linear and critically damped. */
static inline double noslip_approach_acceleration(const noslip_approach *self, double most,
                                double distance, double rate)
{
    const double zone = most * self->settling * self->settling;
    const double ahead = self->settling * rate, place = distance + ahead;
    double curve = ahead + place;      /* in the zone; beyond it, how far the rate is above that of the braking curve */
    if (!(noslip_abs(place) <= zone)) {
        const double root = noslip_sqrt(zone * (zone + 8 * noslip_abs(place)));
        curve = place > 0 ? ahead + (root - zone) / 2 : ahead - (root - zone) / 2;
    }
    return curve > zone ? -most : curve < -zone ? most : -most * (curve / zone);
}

/* Advances the desired speed by dt (s) towards `speed` with bounded jerk: to the speed, the acceleration is what the rate is to a
 * distance. */
static inline void noslip_approach_speed(const noslip_approach *self, double dt,
                       double speed, noslip_approached *next)
{
    const double jerk = noslip_approach_acceleration(self, self->jerk, next->speed - speed, next->speed_rate);
    const double rate = noslip_clip(next->speed_rate + dt * jerk, self->acceleration);
    next->speed += dt * (next->speed_rate + rate) / 2;
    next->speed_rate = rate;
}

/*
 * Advances by dt (s), the time since the previous call (0 at the first after a start), and computes what is desired until the next:
 * `speed` (m/s) is the final one. dt must be at most settling. Returns NOSLIP_NONFINITE or NOSLIP_RANGE if an argument is not
 * finite or out of range; then nothing changes and `desired` is zero.
 */
static inline int noslip_approach_step(noslip_approach *self, double dt, double speed,
                noslip_approached *desired)
{
    static const noslip_approached zero = {0, 0, 0, 0, 0};
    noslip_approached next;
    double missing, time = 0;
    int status = NOSLIP_OK;
    if (desired == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->ready != NOSLIP_READY) {
        noslip_approach_copy(&zero, desired);
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    noslip_approach_copy(&self->desired, &next);
    if (!(noslip_is_finite(dt) && noslip_is_finite(speed))) {
        status = NOSLIP_NONFINITE;
    } else if (!(dt >= 0 && dt <= self->settling)) {
        status = NOSLIP_RANGE;
    } else {
        if (self->jerk > 0) {
            time = self->plan.time + dt < self->plan.duration ? self->plan.time + dt : self->plan.duration;
            noslip_plan_at(self, time, &next);
            noslip_approach_speed(self, dt, speed, &next);
        } else {
            next.distance += dt * (next.distance_rate + dt * next.distance_acceleration / 2);
            next.distance_rate += dt * next.distance_acceleration;
            next.distance_acceleration = noslip_approach_acceleration(self, self->acceleration, next.distance,
                                                                                   next.distance_rate);
            next.speed += dt * next.speed_rate;
            missing = (speed - next.speed) / self->settling; /* linear at the end too */
            next.speed_rate = noslip_clip(missing, self->acceleration);
        }
        if (!(noslip_is_finite(next.distance + next.distance_rate) &&
              noslip_is_finite(next.distance_acceleration + next.speed + next.speed_rate))) {
            status = NOSLIP_NONFINITE;
        }
    }
    if (status == NOSLIP_OK) {
        noslip_approach_copy(&next, &self->desired);
        self->plan.time = time;
    }
    noslip_approach_copy(status == NOSLIP_OK ? &next : &zero, desired);
    return status;
}

/*
 * Keeps the desired speed of the last step from 0 to `speed` (m/s), which a path allows now and changes by `speed_rate` (m/s^2);
 * a speed on the other side of 0 stays. To be called after a step where a path ends or has cusps: it brakes later, but in time.
 * Returns NOSLIP_NONFINITE if an argument is not finite; then nothing changes and `desired` is zero.
 */
static inline int noslip_approach_within(noslip_approach *self, double speed,
                       double speed_rate, noslip_approached *desired)
{
    static const noslip_approached zero = {0, 0, 0, 0, 0};
    int status = NOSLIP_OK;
    if (desired == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->ready != NOSLIP_READY) {
        status = self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    } else if (!(noslip_is_finite(speed) && noslip_is_finite(speed_rate))) {
        status = NOSLIP_NONFINITE;
    } else if ((speed >= 0 && self->desired.speed > speed) || (speed <= 0 && self->desired.speed < speed)) {
        self->desired.speed = speed;
        self->desired.speed_rate = speed_rate;
    }
    noslip_approach_copy(status == NOSLIP_OK ? &self->desired : &zero, desired);
    return status;
}

/* -- float: generated from noslip_approach.inc by guarantees/headers.py ------------------------------------------------ */

/* Desired distance and speed with their derivatives, as in the reference of a law of path following. */
typedef struct noslip_approached_f {
    float distance, distance_rate, distance_acceleration;       /* m, m/s, m/s^2 */
    float speed, speed_rate;                                    /* m/s, m/s^2 */
} noslip_approached_f;

/* A way to distance 0 with bounded jerk: two changes of the rate, each with its largest acceleration in the middle. */
typedef struct noslip_approach_plan_f {
    float side;                  /* 1 or -1: times the distance, the rate between the changes is positive */
    float distance, rate;        /* at its start, times side; not positive where it would stop at once */
    float first, second;         /* m/s: size of the change to the rate between, and to 0 */
    float until, duration;       /* s: end of the first change, and of the second */
    float time;                  /* s: since its start */
} noslip_approach_plan_f;

/* A reference generator: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct noslip_approach_f {
    float acceleration;                   /* m/s^2: largest */
    float settling;                       /* s: time constant of the end */
    float jerk;                           /* m/s^3: largest; 0: no bound */
    noslip_approach_plan_f plan;            /* with a jerk */
    noslip_approached_f desired;            /* of the last step */
    int ready;
} noslip_approach_f;

/* Copies member by member: a compiler may call memcpy for a whole struct. */
static inline void noslip_approach_copy_f(const noslip_approached_f *from, noslip_approached_f *to)
{
    to->distance = from->distance;
    to->distance_rate = from->distance_rate;
    to->distance_acceleration = from->distance_acceleration;
    to->speed = from->speed;
    to->speed_rate = from->speed_rate;
}

/*
 * Initializes with the largest acceleration of distance and of speed (m/s^2), and the time constant `settling` (s) with which the
 * distance ends. With a `jerk` (m/s^3; 0: none) the change of the acceleration is bounded too. Returns NOSLIP_BAD_PARAMETER unless
 * all are finite, the first two positive and jerk not negative.
 */
NOSLIP_NODISCARD static inline int noslip_approach_init_f(noslip_approach_f *self, float acceleration,
                        float settling, float jerk)
{
    static const noslip_approached_f zero = {0, 0, 0, 0, 0};
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (!(noslip_is_positive_f(acceleration) && noslip_is_positive_f(settling) &&
          noslip_is_positive_f(acceleration * settling * settling) && noslip_is_finite_f(jerk) &&
          (!(jerk > 0 || jerk < 0) || (noslip_is_positive_f(jerk * settling * settling) &&
                                       noslip_is_positive_f(acceleration / jerk))))) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->acceleration = acceleration;
    self->settling = settling;
    self->jerk = jerk;
    self->plan.side = 1; /* at the end of a plan, until start */
    self->plan.until = self->plan.duration = self->plan.time = 0;
    noslip_approach_copy_f(&zero, &self->desired);
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* How a rate changes from rest to `size` (m/s): with bounded jerk up to its largest acceleration and back, as fast as possible. */
typedef struct noslip_rise_f {
    float jerk, size;       /* m/s^3, m/s */
    float bend, hold;       /* s: in which the acceleration rises, and in which it stays */
} noslip_rise_f;

/* Returns the fastest change of a rate by `size`, not negative. */
static inline noslip_rise_f noslip_rise_of_f(const noslip_approach_f *self, float size)
{
    const float most = self->acceleration / self->jerk, bend = noslip_sqrt_f(size / self->jerk);
    noslip_rise_f rise;
    rise.jerk = self->jerk;
    rise.size = size;
    rise.bend = bend < most ? bend : most;
    rise.hold = bend < most ? 0 : size / self->acceleration - most;
    return rise;
}

/* Returns how long a change takes, s. */
static inline float noslip_rise_time_f(const noslip_rise_f *rise)
{
    return 2 * rise->bend + rise->hold;
}

/* Computes way (m), rate and acceleration at a time (s) of a change from rest, which is within it. */
static inline void noslip_rise_at_f(const noslip_rise_f *rise, float time, float at[3])
{
    const float duration = noslip_rise_time_f(rise), left = duration - time;
    const float bend = time < rise->bend ? time : left < rise->bend ? left : rise->bend;
    const float acceleration = rise->jerk * bend, rate = acceleration * bend / 2, way = rate * bend / 3;
    if (left < rise->bend && !(time < rise->bend)) { /* the end is the start in reverse */
        at[0] = rise->size * (duration / 2 - left) + way;
        at[1] = rise->size - rate;
    } else {
        const float since = time - bend;
        at[0] = way + since * (rate + since * acceleration / 2);
        at[1] = rate + since * acceleration;
    }
    at[2] = acceleration;
}

/* Returns the distance (m) at which a plan with a rate of `peak` (m/s) between its changes ends. */
static inline float noslip_plan_end_f(const noslip_approach_f *self,
                           const noslip_approach_plan_f *plan, float peak)
{
    const noslip_rise_f first = noslip_rise_of_f(self, peak - plan->rate);
    const noslip_rise_f second = noslip_rise_of_f(self, peak);
    return plan->distance + (plan->rate + peak) / 2 * noslip_rise_time_f(&first) +
           peak / 2 * noslip_rise_time_f(&second);
}

/*
 * Computes the fastest plan from a distance and its rate, without acceleration, to 0. The rate between its changes is where the
 * end, which grows with that rate, is 0: by bisection between the rates at which it is before and beyond.
 */
static inline void noslip_plan_of_f(const noslip_approach_f *self, float distance, float rate,
             noslip_approach_plan_f *plan)
{
    const noslip_rise_f stop = noslip_rise_of_f(self, noslip_abs_f(rate));
    const float rest = distance + rate / 2 * noslip_rise_time_f(&stop);
    noslip_rise_f first, second;
    float low, high;
    int i;
    plan->side = rest > 0 ? -1 : 1;
    plan->distance = plan->side * distance;
    plan->rate = plan->side * rate;
    low = plan->rate > 0 ? plan->rate : 0;
    high = low + noslip_sqrt_f(2 * self->acceleration * noslip_abs_f(rest));
    for (i = 0; i < NOSLIP_HALVINGS; i++) {
        const float middle = low + (high - low) / 2;
        if (noslip_plan_end_f(self, plan, middle) < 0) {
            low = middle;
        } else {
            high = middle;
        }
    }
    plan->first = high - plan->rate;
    plan->second = high;
    first = noslip_rise_of_f(self, plan->first);
    second = noslip_rise_of_f(self, plan->second);
    plan->until = noslip_rise_time_f(&first);
    plan->duration = plan->until + noslip_rise_time_f(&second);
    plan->time = 0;
}

/* Computes distance, rate and acceleration at a time (s) of the plan. The second change is one from rest in reverse. */
static inline void noslip_plan_at_f(const noslip_approach_f *self, float time,
                   noslip_approached_f *desired)
{
    const noslip_approach_plan_f *plan = &self->plan;
    const float left = plan->duration - time;
    float at[3];
    if (time < plan->until) {
        const noslip_rise_f rise = noslip_rise_of_f(self, plan->first);
        noslip_rise_at_f(&rise, time, at);
        at[0] += plan->distance + plan->rate * time;
        at[1] += plan->rate;
    } else if (left > 0) {
        const noslip_rise_f rise = noslip_rise_of_f(self, plan->second);
        noslip_rise_at_f(&rise, left, at);
        at[0] = -at[0];
        at[2] = -at[2];
    } else {
        at[0] = at[1] = at[2] = 0;
    }
    desired->distance = plan->side * at[0];
    desired->distance_rate = plan->side * at[1];
    desired->distance_acceleration = plan->side * at[2];
}

/*
 * Begins where the vehicle is: with its distance from the path (m), the rate of that (m/s) and its speed (m/s). To be called before
 * the first step, and again after the pose was corrected or the path changed. Returns NOSLIP_NONFINITE if one is not finite.
 */
static inline int noslip_approach_start_f(noslip_approach_f *self, float distance,
                         float distance_rate, float speed)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!(noslip_is_finite_f(distance) && noslip_is_finite_f(distance_rate) &&
        noslip_is_finite_f(speed))) {
        return NOSLIP_NONFINITE;
    }
    if (self->jerk > 0) {
        noslip_approach_plan_f plan;
        noslip_plan_of_f(self, distance, distance_rate, &plan);
        if (!(noslip_is_finite_f(plan.first + plan.second) && noslip_is_finite_f(plan.duration))) {
            return NOSLIP_NONFINITE;
        }
        noslip_copy(&self->plan, &plan, sizeof plan);
    }
    self->desired.distance = distance;
    self->desired.distance_rate = distance_rate;
    self->desired.distance_acceleration = 0;
    self->desired.speed = speed;
    self->desired.speed_rate = 0;
    return NOSLIP_OK;
}

/* Returns the acceleration, at most `most`, from a distance and its rate to 0, time-optimal up to a zone of size most settling^2 where
 * it is linear and critically damped. */
static inline float noslip_approach_acceleration_f(const noslip_approach_f *self, float most,
                                  float distance, float rate)
{
    const float zone = most * self->settling * self->settling;
    const float ahead = self->settling * rate, place = distance + ahead;
    float curve = ahead + place;       /* in the zone; beyond it, how far the rate is above that of the braking curve */
    if (!(noslip_abs_f(place) <= zone)) {
        const float root = noslip_sqrt_f(zone * (zone + 8 * noslip_abs_f(place)));
        curve = place > 0 ? ahead + (root - zone) / 2 : ahead - (root - zone) / 2;
    }
    return curve > zone ? -most : curve < -zone ? most : -most * (curve / zone);
}

/* Advances the desired speed by dt (s) towards `speed` with bounded jerk: to the speed, the acceleration is what the rate is to a
 * distance. */
static inline void noslip_approach_speed_f(const noslip_approach_f *self, float dt,
                          float speed, noslip_approached_f *next)
{
    const float jerk = noslip_approach_acceleration_f(self, self->jerk, next->speed - speed, next->speed_rate);
    const float rate = noslip_clip_f(next->speed_rate + dt * jerk, self->acceleration);
    next->speed += dt * (next->speed_rate + rate) / 2;
    next->speed_rate = rate;
}

/*
 * Advances by dt (s), the time since the previous call (0 at the first after a start), and computes what is desired until the next:
 * `speed` (m/s) is the final one. dt must be at most settling. Returns NOSLIP_NONFINITE or NOSLIP_RANGE if an argument is not
 * finite or out of range; then nothing changes and `desired` is zero.
 */
static inline int noslip_approach_step_f(noslip_approach_f *self, float dt, float speed,
                  noslip_approached_f *desired)
{
    static const noslip_approached_f zero = {0, 0, 0, 0, 0};
    noslip_approached_f next;
    float missing, time = 0;
    int status = NOSLIP_OK;
    if (desired == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->ready != NOSLIP_READY) {
        noslip_approach_copy_f(&zero, desired);
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    noslip_approach_copy_f(&self->desired, &next);
    if (!(noslip_is_finite_f(dt) && noslip_is_finite_f(speed))) {
        status = NOSLIP_NONFINITE;
    } else if (!(dt >= 0 && dt <= self->settling)) {
        status = NOSLIP_RANGE;
    } else {
        if (self->jerk > 0) {
            time = self->plan.time + dt < self->plan.duration ? self->plan.time + dt : self->plan.duration;
            noslip_plan_at_f(self, time, &next);
            noslip_approach_speed_f(self, dt, speed, &next);
        } else {
            next.distance += dt * (next.distance_rate + dt * next.distance_acceleration / 2);
            next.distance_rate += dt * next.distance_acceleration;
            next.distance_acceleration = noslip_approach_acceleration_f(self, self->acceleration, next.distance,
                                                                                   next.distance_rate);
            next.speed += dt * next.speed_rate;
            missing = (speed - next.speed) / self->settling; /* linear at the end too */
            next.speed_rate = noslip_clip_f(missing, self->acceleration);
        }
        if (!(noslip_is_finite_f(next.distance + next.distance_rate) &&
              noslip_is_finite_f(next.distance_acceleration + next.speed + next.speed_rate))) {
            status = NOSLIP_NONFINITE;
        }
    }
    if (status == NOSLIP_OK) {
        noslip_approach_copy_f(&next, &self->desired);
        self->plan.time = time;
    }
    noslip_approach_copy_f(status == NOSLIP_OK ? &next : &zero, desired);
    return status;
}

/*
 * Keeps the desired speed of the last step from 0 to `speed` (m/s), which a path allows now and changes by `speed_rate` (m/s^2);
 * a speed on the other side of 0 stays. To be called after a step where a path ends or has cusps: it brakes later, but in time.
 * Returns NOSLIP_NONFINITE if an argument is not finite; then nothing changes and `desired` is zero.
 */
static inline int noslip_approach_within_f(noslip_approach_f *self, float speed,
                          float speed_rate, noslip_approached_f *desired)
{
    static const noslip_approached_f zero = {0, 0, 0, 0, 0};
    int status = NOSLIP_OK;
    if (desired == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->ready != NOSLIP_READY) {
        status = self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    } else if (!(noslip_is_finite_f(speed) && noslip_is_finite_f(speed_rate))) {
        status = NOSLIP_NONFINITE;
    } else if ((speed >= 0 && self->desired.speed > speed) || (speed <= 0 && self->desired.speed < speed)) {
        self->desired.speed = speed;
        self->desired.speed_rate = speed_rate;
    }
    noslip_approach_copy_f(status == NOSLIP_OK ? &self->desired : &zero, desired);
    return status;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
