/*
 * noslip_slip.h - notices that wheels slip, and lowers the friction that is believed for a while.
 *
 * A gyro turns with the vehicle, and so do the wheels as long as they roll: heading = turn[0] angle[0] + turn[1] angle[1]. With an
 * accelerometer the speed is compared too. Both are compared over the last moments, `window`. The wheels slip where the difference
 * is larger than all errors together may make it:
 *
 *     |turn[i]| (count[i] + geometry |angle[i]|) for each wheel + gyro_bias * time + deviations * (standard deviation)
 *
 * The counts of an encoder, the geometry and the bias are bounds, of which the first does not grow with time. Only noise is random:
 * the probability of a false alarm is at most that of a normal number beyond `deviations`, at each call: with 6 it is 2e-9, less
 * than one in 1000 hours at 100 Hz, for each of the two comparisons.
 *
 *     noslip_odometry_differential_f(&vehicle, r, b, d);
 *     noslip_slip_init_f(&slip, &slip_options, &vehicle);
 *     ...
 *     status = noslip_slip_step_f(&slip, &reading, dt, &noticed);         at each call, before the step of the law
 *     noslip_slip_grip_f(&slip, &options.friction, &law.grip);            the law keeps its wheels within noticed.mu
 *     reference.speed *= noticed.slower;                                  and speed_rate alike
 *
 * noticed.slower is the root of mu over that of the options: all accelerations along the path are then less by mu.
 *
 * Each time slip is noticed, mu is multiplied by `lower`, down to `least`; slip that goes on is noticed again. It rises by `rise`
 * per second once nothing was noticed for `hold`. Dead reckoning is wrong by what slipped: uncertain_heading and uncertain_way grow
 * by the difference of the heading and by the way of the wheels in the window; noslip_slip_trust, after a correction, clears them.
 *
 * What is not noticed: without accelerations, slip alike of both wheels, as in braking straight ahead; and slip sideways alone. In
 * place of an accelerometer, the acceleration may be the one that the law desired, with an acceleration_bias that covers what
 * the model lacks, where its step returned NOSLIP_OK; else it is not known. A mean over a call is meant: of a gyro that is sampled
 * at the calls, take the mean of two readings.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_SLIP_H
#define NOSLIP_SLIP_H

#include "noslip_grip.h"
#include "noslip_odometry.h"

/* -- double: generated from noslip_slip.inc by guarantees/headers.py --------------------------------------------------- */

/* What is known of the sensors, and what is done where the wheels slip. */
typedef struct noslip_slip_options {
    double window;                  /* s: differences count for about so long */
    double count[2];                /* rad: angle of one count of each wheel's encoder; 0: the angles are exact */
    double wheel_noise;             /* rad/s: standard deviation of the rate of a wheel over one call */
    double gyro_noise;              /* rad/s: standard deviation of a reading */
    double gyro_bias;               /* rad/s: largest constant error */
    double acceleration_noise;      /* m/s^2: standard deviation of a reading */
    double acceleration_bias;       /* m/s^2: largest constant error, with that of a slope */
    double geometry;                /* largest relative error of the ways of the wheels, by their radii and their distance */
    double deviations;              /* threshold, in standard deviations beyond the bounds of all other errors */
    double mu, least;               /* friction believed without slip, and the least that is believed */
    double lower;                   /* factor of mu each time that slip is noticed, above 0 and below 1 */
    double pause;                   /* s: slip that goes on is noticed again only after so long, at most hold */
    double rise;                    /* 1/s: mu rises by so much per second */
    double hold;                    /* s: after so long without slip */
} noslip_slip_options;

/* What was measured since the last call. */
typedef struct noslip_slip_reading {
    double angle[2];          /* rad: by which the wheels turned */
    double yaw_rate;          /* rad/s: of the gyro, its mean */
    double acceleration;      /* m/s^2: of the middle of the axle, forward */
    int accelerates;          /* 0: the acceleration is not known */
} noslip_slip_reading;

/* Sums in which what is s old counts for exp(-s / window). */
typedef struct noslip_slip_sums {
    double time;                /* s */
    double angle[2];            /* rad: by which the wheels turned */
    double change[2];           /* rad/s: by which their rates changed */
    double heading;             /* rad: by the gyro */
    double speed;               /* m/s: by the accelerations */
    double heading_square;      /* rad^2: variance of the heading's difference */
    double speed_square;        /* (m/s)^2 */
} noslip_slip_sums;

/* What is noticed, and what follows from it until the next call. */
typedef struct noslip_noticed {
    double mu;                      /* friction that may be believed */
    double slower;                  /* factor of a desired speed along a path and of its rate, at most 1 */
    double uncertain_heading;       /* rad: by which dead reckoning may be wrong because of slip, since init or trust */
    double uncertain_way;           /* m */
    double heading_difference;      /* rad: gyro less wheels */
    double heading_threshold;       /* rad: beyond it the wheels slip */
    double speed_difference;        /* m/s: accelerations less wheels; 0 if the acceleration is not known */
    double speed_threshold;         /* m/s */
} noslip_noticed;

/* Notices slip: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct noslip_slip {
    noslip_slip_options options;
    double forward[2], turn[2];      /* m/rad and rad/rad, of each wheel */
    noslip_slip_sums sums;
    double rate[2];                  /* rad/s: of the wheels, at the last call */
    double frequency;                /* 1/s: of the calls */
    double quiet;                    /* s: since slip was noticed, at most options.hold */
    noslip_noticed noticed;
    int known;                       /* 1: `rate` is known */
    int ready;
} noslip_slip;

/* Returns 1 if x is finite and not negative. */
static inline int noslip_slip_bound(double x)
{
    return noslip_is_finite(x) && x >= 0;
}

/* Returns 1 if all options are in their ranges. */
static inline int noslip_slip_options_ok(const noslip_slip_options *options)
{
    return noslip_is_positive(options->window) && noslip_slip_bound(options->count[0]) &&
           noslip_slip_bound(options->count[1]) && noslip_slip_bound(options->wheel_noise) &&
           noslip_slip_bound(options->gyro_noise) && noslip_slip_bound(options->gyro_bias) &&
           noslip_slip_bound(options->acceleration_noise) &&
           noslip_slip_bound(options->acceleration_bias) && noslip_slip_bound(options->geometry) &&
           noslip_slip_bound(options->deviations) && noslip_is_positive(options->mu) &&
           noslip_is_positive(options->least) && options->least <= options->mu &&
           noslip_is_positive(options->lower) && options->lower < 1 &&
           noslip_slip_bound(options->pause) && options->pause <= options->hold &&
           noslip_slip_bound(options->rise) && noslip_slip_bound(options->hold);
}

/* Copies member by member: a compiler may call memcpy for a whole struct. */
NOSLIP_APART void noslip_slip_copy(const noslip_slip_sums *from, noslip_slip_sums *to)
{
    to->time = from->time;
    to->angle[0] = from->angle[0];
    to->angle[1] = from->angle[1];
    to->change[0] = from->change[0];
    to->change[1] = from->change[1];
    to->heading = from->heading;
    to->speed = from->speed;
    to->heading_square = from->heading_square;
    to->speed_square = from->speed_square;
}

/* The same. */
NOSLIP_APART void noslip_noticed_copy(const noslip_noticed *from, noslip_noticed *to)
{
    to->mu = from->mu;
    to->slower = from->slower;
    to->uncertain_heading = from->uncertain_heading;
    to->uncertain_way = from->uncertain_way;
    to->heading_difference = from->heading_difference;
    to->heading_threshold = from->heading_threshold;
    to->speed_difference = from->speed_difference;
    to->speed_threshold = from->speed_threshold;
}

/* Begins all sums. */
static inline void noslip_slip_clear(noslip_slip_sums *sums)
{
    sums->time = 0;
    sums->angle[0] = sums->angle[1] = 0;
    sums->change[0] = sums->change[1] = 0;
    sums->heading = sums->speed = 0;
    sums->heading_square = sums->speed_square = 0;
}

/*
 * Initializes for the vehicle of `vehicle`, whose forward and turn are used, with mu as in the options and no uncertainty. Returns
 * NOSLIP_BAD_PARAMETER if an option is not in its range or no wheel turns the vehicle.
 */
NOSLIP_NODISCARD static inline int noslip_slip_init(noslip_slip *self,
                                       const noslip_slip_options *options,
                                       const noslip_odometry_options *vehicle)
{
    static const noslip_noticed nothing = {0, 0, 0, 0, 0, 0, 0, 0};
    int i;
    if (self != NULL) {
        self->ready = 0;
    }
    if (self == NULL || options == NULL || vehicle == NULL) {
        return NOSLIP_NULL;
    }
    if (!(noslip_slip_options_ok(options) && noslip_all_finite(vehicle->forward, 2) &&
          noslip_all_finite(vehicle->turn, 2) &&
          noslip_abs(vehicle->turn[0]) + noslip_abs(vehicle->turn[1]) > 0)) {
        return NOSLIP_BAD_PARAMETER;
    }
    noslip_copy(&self->options, options, sizeof *options);
    for (i = 0; i < 2; i++) {
        self->forward[i] = vehicle->forward[i];
        self->turn[i] = vehicle->turn[i];
        self->rate[i] = 0;
    }
    noslip_slip_clear(&self->sums);
    self->frequency = 0;
    self->quiet = options->hold;
    noslip_noticed_copy(&nothing, &self->noticed);
    self->noticed.mu = options->mu;
    self->noticed.slower = 1;
    self->known = 0;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* Adds a reading of dt (s) to the sums, of which `keeps` is kept; `now` is 1 / dt. */
NOSLIP_APART void noslip_slip_add(const noslip_slip *self,
                      const noslip_slip_reading *reading, double now,
                      double dt, double keeps, noslip_slip_sums *sums)
{
    const noslip_slip_options *options = &self->options;
    const double wheels = options->wheel_noise * dt, one = self->turn[0] * wheels, other = self->turn[1] * wheels;
    const double gyro = options->gyro_noise * dt, gained = options->acceleration_noise * dt;
    int i;
    for (i = 0; i < 2; i++) {
        sums->angle[i] = keeps * (sums->angle[i] + reading->angle[i]);
        sums->change[i] = keeps * (sums->change[i] + (self->known ? reading->angle[i] * now - self->rate[i] : 0));
    }
    sums->time = keeps * (sums->time + dt);
    sums->heading = keeps * (sums->heading + reading->yaw_rate * dt);
    sums->speed = keeps * (sums->speed + (reading->accelerates ? reading->acceleration * dt : 0));
    sums->heading_square = keeps * keeps * (sums->heading_square + gyro * gyro + one * one + other * other);
    sums->speed_square = keeps * keeps * (sums->speed_square + gained * gained);
}

/* Compares the sums, and adds to the uncertainty what it is if the wheels slip; `coarse` (1/s) is the largest error of the change
 * of a rate, in counts. */
NOSLIP_APART void noslip_slip_compare(const noslip_slip *self,
                          const noslip_slip_sums *sums, double coarse,
                          noslip_noticed *noticed)
{
    const noslip_slip_options *options = &self->options;
    double heading = sums->heading, speed = sums->speed, speed_square = sums->speed_square;
    double heading_threshold = options->gyro_bias * sums->time, speed_threshold = options->acceleration_bias * sums->time;
    int i;
    for (i = 0; i < 2; i++) {
        const double turn = noslip_abs(self->turn[i]), forward = noslip_abs(self->forward[i]);
        const double angle = noslip_abs(sums->angle[i]), change = noslip_abs(sums->change[i]);
        const double noise = forward * options->wheel_noise;
        heading -= self->turn[i] * sums->angle[i];
        speed -= self->forward[i] * sums->change[i];
        heading_threshold += turn * (options->count[i] + options->geometry * angle);
        speed_threshold += forward * (options->count[i] * coarse + options->geometry * change);
        noticed->uncertain_way += forward * angle;
        speed_square += noise * noise;
    }
    noticed->uncertain_heading += noslip_abs(heading);
    noticed->heading_difference = heading;
    noticed->heading_threshold = heading_threshold + options->deviations * noslip_sqrt(sums->heading_square);
    noticed->speed_difference = speed;
    noticed->speed_threshold = speed_threshold + options->deviations * noslip_sqrt(speed_square);
}

/* Returns 1 if all numbers are finite. */
NOSLIP_APART int noslip_slip_finite(const noslip_slip_sums *sums,
                        const noslip_noticed *noticed)
{
    return noslip_all_finite(sums->angle, 2) && noslip_all_finite(sums->change, 2) &&
           noslip_is_finite(sums->heading) && noslip_is_finite(sums->speed) &&
           noslip_is_finite(sums->heading_square) && noslip_is_finite(sums->speed_square) &&
           noslip_is_finite(noticed->uncertain_heading) && noslip_is_finite(noticed->uncertain_way) &&
           noslip_is_finite(noticed->heading_difference) &&
           noslip_is_finite(noticed->heading_threshold) &&
           noslip_is_finite(noticed->speed_difference) && noslip_is_finite(noticed->speed_threshold);
}

/* Returns the friction that is believed from now on: less if the wheels slip, more when they have not for long enough. */
static inline double noslip_slip_believed(const noslip_slip_options *options, double mu,
                        int slips, int rises, double dt)
{
    if (slips) {
        const double lower = mu * options->lower;
        mu = lower > options->least ? lower : options->least;
    } else if (rises) {
        const double higher = mu + options->rise * dt;
        mu = higher < options->mu ? higher : options->mu;
    }
    return mu;
}

/*
 * Takes what was measured during the last dt (s), and writes what is noticed. Returns NOSLIP_SLIPPING from the call at which slip is
 * noticed until options.hold later, and NOSLIP_OK otherwise. On an error nothing changes, and `noticed` is the previous one, zeros
 * before init: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_BAD_PARAMETER unless dt is positive.
 */
static inline int noslip_slip_step(noslip_slip *self,
                      const noslip_slip_reading *reading, double dt,
                      noslip_noticed *noticed)
{
    static const noslip_noticed nothing = {0, 0, 0, 0, 0, 0, 0, 0};
    noslip_slip_sums sums;
    noslip_noticed next;
    double keeps, now, frequency, quiet;
    int slips;
    if (noticed == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->ready != NOSLIP_READY) {
        noslip_noticed_copy(&nothing, noticed);
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    now = noslip_is_positive(dt) ? 1 / dt : 0;
    if (reading == NULL || !noslip_is_positive(now)) {
        noslip_noticed_copy(&self->noticed, noticed);
        return reading == NULL ? NOSLIP_NULL : noslip_is_finite(dt) ? NOSLIP_BAD_PARAMETER : NOSLIP_NONFINITE;
    }
    keeps = self->options.window / (self->options.window + dt);
    frequency = self->known ? self->frequency : now;
    noslip_slip_copy(&self->sums, &sums);
    noslip_noticed_copy(&self->noticed, &next);
    noslip_slip_add(self, reading, now, dt, keeps, &sums);
    noslip_slip_compare(self, &sums, keeps * (now + frequency), &next);
    frequency = keeps * frequency + (1 - keeps) * now;
    if (!(noslip_slip_finite(&sums, &next) && noslip_is_finite(reading->angle[0] * now) &&
          noslip_is_finite(reading->angle[1] * now) &&
          noslip_is_finite(frequency))) {
        noslip_noticed_copy(&self->noticed, noticed);
        return NOSLIP_NONFINITE;
    }
    slips = noslip_abs(next.heading_difference) > next.heading_threshold;
    if (!reading->accelerates) {
        next.speed_difference = 0;
    } else if (noslip_abs(next.speed_difference) > next.speed_threshold) {
        slips = 1;
    }
    quiet = self->quiet + dt;
    quiet = quiet < self->options.hold ? quiet : self->options.hold;
    slips = slips && quiet >= self->options.pause;
    next.mu = noslip_slip_believed(&self->options, next.mu, slips, !(quiet < self->options.hold), dt);
    next.slower = noslip_sqrt(next.mu / self->options.mu);
    if (slips) {
        noslip_slip_clear(&sums);              /* slip that goes on is noticed again, and lowers mu again */
    } else {
        next.uncertain_heading = self->noticed.uncertain_heading;
        next.uncertain_way = self->noticed.uncertain_way;
    }
    self->rate[0] = reading->angle[0] * now;
    self->rate[1] = reading->angle[1] * now;
    self->frequency = frequency;
    self->known = 1;
    noslip_slip_copy(&sums, &self->sums);
    noslip_noticed_copy(&next, &self->noticed);
    self->quiet = slips ? 0 : quiet;
    noslip_noticed_copy(&next, noticed);
    return slips || self->quiet < self->options.hold ? NOSLIP_SLIPPING : NOSLIP_OK;
}

/*
 * Writes to `grip` what a law, whose friction was `friction`, may use with the mu of the last step; `grip` is that of the law:
 *
 *     noslip_slip_grip(&slip, &options.friction, &law.grip);
 *
 * On an error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_BAD_PARAMETER for a friction that no law takes.
 */
static inline int noslip_slip_grip(const noslip_slip *self,
                      const noslip_friction *friction, noslip_grip *grip)
{
    noslip_friction believed;
    if (self == NULL || friction == NULL || grip == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_friction_ok(friction, 1)) {
        return NOSLIP_BAD_PARAMETER;
    }
    believed.margin = friction->margin;
    believed.share = friction->share;
    believed.height = friction->height;
    believed.mu = self->noticed.mu < friction->mu ? self->noticed.mu : friction->mu;
    *grip = noslip_grip_of(&believed);
    return NOSLIP_OK;
}

/* Forgets the uncertainty of dead reckoning, after the pose was corrected by a measured one. */
static inline int noslip_slip_trust(noslip_slip *self)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    self->noticed.uncertain_heading = self->noticed.uncertain_way = 0;
    return NOSLIP_OK;
}

/* -- float: generated from noslip_slip.inc by guarantees/headers.py ---------------------------------------------------- */

/* What is known of the sensors, and what is done where the wheels slip. */
typedef struct noslip_slip_options_f {
    float window;                   /* s: differences count for about so long */
    float count[2];                 /* rad: angle of one count of each wheel's encoder; 0: the angles are exact */
    float wheel_noise;              /* rad/s: standard deviation of the rate of a wheel over one call */
    float gyro_noise;               /* rad/s: standard deviation of a reading */
    float gyro_bias;                /* rad/s: largest constant error */
    float acceleration_noise;       /* m/s^2: standard deviation of a reading */
    float acceleration_bias;        /* m/s^2: largest constant error, with that of a slope */
    float geometry;                 /* largest relative error of the ways of the wheels, by their radii and their distance */
    float deviations;               /* threshold, in standard deviations beyond the bounds of all other errors */
    float mu, least;                /* friction believed without slip, and the least that is believed */
    float lower;                    /* factor of mu each time that slip is noticed, above 0 and below 1 */
    float pause;                    /* s: slip that goes on is noticed again only after so long, at most hold */
    float rise;                     /* 1/s: mu rises by so much per second */
    float hold;                     /* s: after so long without slip */
} noslip_slip_options_f;

/* What was measured since the last call. */
typedef struct noslip_slip_reading_f {
    float angle[2];           /* rad: by which the wheels turned */
    float yaw_rate;           /* rad/s: of the gyro, its mean */
    float acceleration;       /* m/s^2: of the middle of the axle, forward */
    int accelerates;          /* 0: the acceleration is not known */
} noslip_slip_reading_f;

/* Sums in which what is s old counts for exp(-s / window). */
typedef struct noslip_slip_sums_f {
    float time;                 /* s */
    float angle[2];             /* rad: by which the wheels turned */
    float change[2];            /* rad/s: by which their rates changed */
    float heading;              /* rad: by the gyro */
    float speed;                /* m/s: by the accelerations */
    float heading_square;       /* rad^2: variance of the heading's difference */
    float speed_square;         /* (m/s)^2 */
} noslip_slip_sums_f;

/* What is noticed, and what follows from it until the next call. */
typedef struct noslip_noticed_f {
    float mu;                       /* friction that may be believed */
    float slower;                   /* factor of a desired speed along a path and of its rate, at most 1 */
    float uncertain_heading;        /* rad: by which dead reckoning may be wrong because of slip, since init or trust */
    float uncertain_way;            /* m */
    float heading_difference;       /* rad: gyro less wheels */
    float heading_threshold;        /* rad: beyond it the wheels slip */
    float speed_difference;         /* m/s: accelerations less wheels; 0 if the acceleration is not known */
    float speed_threshold;          /* m/s */
} noslip_noticed_f;

/* Notices slip: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct noslip_slip_f {
    noslip_slip_options_f options;
    float forward[2], turn[2];       /* m/rad and rad/rad, of each wheel */
    noslip_slip_sums_f sums;
    float rate[2];                   /* rad/s: of the wheels, at the last call */
    float frequency;                 /* 1/s: of the calls */
    float quiet;                     /* s: since slip was noticed, at most options.hold */
    noslip_noticed_f noticed;
    int known;                       /* 1: `rate` is known */
    int ready;
} noslip_slip_f;

/* Returns 1 if x is finite and not negative. */
static inline int noslip_slip_bound_f(float x)
{
    return noslip_is_finite_f(x) && x >= 0;
}

/* Returns 1 if all options are in their ranges. */
static inline int noslip_slip_options_ok_f(const noslip_slip_options_f *options)
{
    return noslip_is_positive_f(options->window) && noslip_slip_bound_f(options->count[0]) &&
           noslip_slip_bound_f(options->count[1]) && noslip_slip_bound_f(options->wheel_noise) &&
           noslip_slip_bound_f(options->gyro_noise) && noslip_slip_bound_f(options->gyro_bias) &&
           noslip_slip_bound_f(options->acceleration_noise) &&
           noslip_slip_bound_f(options->acceleration_bias) && noslip_slip_bound_f(options->geometry) &&
           noslip_slip_bound_f(options->deviations) && noslip_is_positive_f(options->mu) &&
           noslip_is_positive_f(options->least) && options->least <= options->mu &&
           noslip_is_positive_f(options->lower) && options->lower < 1 &&
           noslip_slip_bound_f(options->pause) && options->pause <= options->hold &&
           noslip_slip_bound_f(options->rise) && noslip_slip_bound_f(options->hold);
}

/* Copies member by member: a compiler may call memcpy for a whole struct. */
NOSLIP_APART void noslip_slip_copy_f(const noslip_slip_sums_f *from, noslip_slip_sums_f *to)
{
    to->time = from->time;
    to->angle[0] = from->angle[0];
    to->angle[1] = from->angle[1];
    to->change[0] = from->change[0];
    to->change[1] = from->change[1];
    to->heading = from->heading;
    to->speed = from->speed;
    to->heading_square = from->heading_square;
    to->speed_square = from->speed_square;
}

/* The same. */
NOSLIP_APART void noslip_noticed_copy_f(const noslip_noticed_f *from, noslip_noticed_f *to)
{
    to->mu = from->mu;
    to->slower = from->slower;
    to->uncertain_heading = from->uncertain_heading;
    to->uncertain_way = from->uncertain_way;
    to->heading_difference = from->heading_difference;
    to->heading_threshold = from->heading_threshold;
    to->speed_difference = from->speed_difference;
    to->speed_threshold = from->speed_threshold;
}

/* Begins all sums. */
static inline void noslip_slip_clear_f(noslip_slip_sums_f *sums)
{
    sums->time = 0;
    sums->angle[0] = sums->angle[1] = 0;
    sums->change[0] = sums->change[1] = 0;
    sums->heading = sums->speed = 0;
    sums->heading_square = sums->speed_square = 0;
}

/*
 * Initializes for the vehicle of `vehicle`, whose forward and turn are used, with mu as in the options and no uncertainty. Returns
 * NOSLIP_BAD_PARAMETER if an option is not in its range or no wheel turns the vehicle.
 */
NOSLIP_NODISCARD static inline int noslip_slip_init_f(noslip_slip_f *self,
                                           const noslip_slip_options_f *options,
                                           const noslip_odometry_options_f *vehicle)
{
    static const noslip_noticed_f nothing = {0, 0, 0, 0, 0, 0, 0, 0};
    int i;
    if (self != NULL) {
        self->ready = 0;
    }
    if (self == NULL || options == NULL || vehicle == NULL) {
        return NOSLIP_NULL;
    }
    if (!(noslip_slip_options_ok_f(options) && noslip_all_finite_f(vehicle->forward, 2) &&
          noslip_all_finite_f(vehicle->turn, 2) &&
          noslip_abs_f(vehicle->turn[0]) + noslip_abs_f(vehicle->turn[1]) > 0)) {
        return NOSLIP_BAD_PARAMETER;
    }
    noslip_copy(&self->options, options, sizeof *options);
    for (i = 0; i < 2; i++) {
        self->forward[i] = vehicle->forward[i];
        self->turn[i] = vehicle->turn[i];
        self->rate[i] = 0;
    }
    noslip_slip_clear_f(&self->sums);
    self->frequency = 0;
    self->quiet = options->hold;
    noslip_noticed_copy_f(&nothing, &self->noticed);
    self->noticed.mu = options->mu;
    self->noticed.slower = 1;
    self->known = 0;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* Adds a reading of dt (s) to the sums, of which `keeps` is kept; `now` is 1 / dt. */
NOSLIP_APART void noslip_slip_add_f(const noslip_slip_f *self,
                          const noslip_slip_reading_f *reading, float now,
                          float dt, float keeps, noslip_slip_sums_f *sums)
{
    const noslip_slip_options_f *options = &self->options;
    const float wheels = options->wheel_noise * dt, one = self->turn[0] * wheels, other = self->turn[1] * wheels;
    const float gyro = options->gyro_noise * dt, gained = options->acceleration_noise * dt;
    int i;
    for (i = 0; i < 2; i++) {
        sums->angle[i] = keeps * (sums->angle[i] + reading->angle[i]);
        sums->change[i] = keeps * (sums->change[i] + (self->known ? reading->angle[i] * now - self->rate[i] : 0));
    }
    sums->time = keeps * (sums->time + dt);
    sums->heading = keeps * (sums->heading + reading->yaw_rate * dt);
    sums->speed = keeps * (sums->speed + (reading->accelerates ? reading->acceleration * dt : 0));
    sums->heading_square = keeps * keeps * (sums->heading_square + gyro * gyro + one * one + other * other);
    sums->speed_square = keeps * keeps * (sums->speed_square + gained * gained);
}

/* Compares the sums, and adds to the uncertainty what it is if the wheels slip; `coarse` (1/s) is the largest error of the change
 * of a rate, in counts. */
NOSLIP_APART void noslip_slip_compare_f(const noslip_slip_f *self,
                              const noslip_slip_sums_f *sums, float coarse,
                              noslip_noticed_f *noticed)
{
    const noslip_slip_options_f *options = &self->options;
    float heading = sums->heading, speed = sums->speed, speed_square = sums->speed_square;
    float heading_threshold = options->gyro_bias * sums->time, speed_threshold = options->acceleration_bias * sums->time;
    int i;
    for (i = 0; i < 2; i++) {
        const float turn = noslip_abs_f(self->turn[i]), forward = noslip_abs_f(self->forward[i]);
        const float angle = noslip_abs_f(sums->angle[i]), change = noslip_abs_f(sums->change[i]);
        const float noise = forward * options->wheel_noise;
        heading -= self->turn[i] * sums->angle[i];
        speed -= self->forward[i] * sums->change[i];
        heading_threshold += turn * (options->count[i] + options->geometry * angle);
        speed_threshold += forward * (options->count[i] * coarse + options->geometry * change);
        noticed->uncertain_way += forward * angle;
        speed_square += noise * noise;
    }
    noticed->uncertain_heading += noslip_abs_f(heading);
    noticed->heading_difference = heading;
    noticed->heading_threshold = heading_threshold + options->deviations * noslip_sqrt_f(sums->heading_square);
    noticed->speed_difference = speed;
    noticed->speed_threshold = speed_threshold + options->deviations * noslip_sqrt_f(speed_square);
}

/* Returns 1 if all numbers are finite. */
NOSLIP_APART int noslip_slip_finite_f(const noslip_slip_sums_f *sums,
                            const noslip_noticed_f *noticed)
{
    return noslip_all_finite_f(sums->angle, 2) && noslip_all_finite_f(sums->change, 2) &&
           noslip_is_finite_f(sums->heading) && noslip_is_finite_f(sums->speed) &&
           noslip_is_finite_f(sums->heading_square) && noslip_is_finite_f(sums->speed_square) &&
           noslip_is_finite_f(noticed->uncertain_heading) && noslip_is_finite_f(noticed->uncertain_way) &&
           noslip_is_finite_f(noticed->heading_difference) &&
           noslip_is_finite_f(noticed->heading_threshold) &&
           noslip_is_finite_f(noticed->speed_difference) && noslip_is_finite_f(noticed->speed_threshold);
}

/* Returns the friction that is believed from now on: less if the wheels slip, more when they have not for long enough. */
static inline float noslip_slip_believed_f(const noslip_slip_options_f *options, float mu,
                          int slips, int rises, float dt)
{
    if (slips) {
        const float lower = mu * options->lower;
        mu = lower > options->least ? lower : options->least;
    } else if (rises) {
        const float higher = mu + options->rise * dt;
        mu = higher < options->mu ? higher : options->mu;
    }
    return mu;
}

/*
 * Takes what was measured during the last dt (s), and writes what is noticed. Returns NOSLIP_SLIPPING from the call at which slip is
 * noticed until options.hold later, and NOSLIP_OK otherwise. On an error nothing changes, and `noticed` is the previous one, zeros
 * before init: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_NONFINITE, NOSLIP_BAD_PARAMETER unless dt is positive.
 */
static inline int noslip_slip_step_f(noslip_slip_f *self,
                          const noslip_slip_reading_f *reading, float dt,
                          noslip_noticed_f *noticed)
{
    static const noslip_noticed_f nothing = {0, 0, 0, 0, 0, 0, 0, 0};
    noslip_slip_sums_f sums;
    noslip_noticed_f next;
    float keeps, now, frequency, quiet;
    int slips;
    if (noticed == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->ready != NOSLIP_READY) {
        noslip_noticed_copy_f(&nothing, noticed);
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    now = noslip_is_positive_f(dt) ? 1 / dt : 0;
    if (reading == NULL || !noslip_is_positive_f(now)) {
        noslip_noticed_copy_f(&self->noticed, noticed);
        return reading == NULL ? NOSLIP_NULL : noslip_is_finite_f(dt) ? NOSLIP_BAD_PARAMETER : NOSLIP_NONFINITE;
    }
    keeps = self->options.window / (self->options.window + dt);
    frequency = self->known ? self->frequency : now;
    noslip_slip_copy_f(&self->sums, &sums);
    noslip_noticed_copy_f(&self->noticed, &next);
    noslip_slip_add_f(self, reading, now, dt, keeps, &sums);
    noslip_slip_compare_f(self, &sums, keeps * (now + frequency), &next);
    frequency = keeps * frequency + (1 - keeps) * now;
    if (!(noslip_slip_finite_f(&sums, &next) && noslip_is_finite_f(reading->angle[0] * now) &&
          noslip_is_finite_f(reading->angle[1] * now) &&
          noslip_is_finite_f(frequency))) {
        noslip_noticed_copy_f(&self->noticed, noticed);
        return NOSLIP_NONFINITE;
    }
    slips = noslip_abs_f(next.heading_difference) > next.heading_threshold;
    if (!reading->accelerates) {
        next.speed_difference = 0;
    } else if (noslip_abs_f(next.speed_difference) > next.speed_threshold) {
        slips = 1;
    }
    quiet = self->quiet + dt;
    quiet = quiet < self->options.hold ? quiet : self->options.hold;
    slips = slips && quiet >= self->options.pause;
    next.mu = noslip_slip_believed_f(&self->options, next.mu, slips, !(quiet < self->options.hold), dt);
    next.slower = noslip_sqrt_f(next.mu / self->options.mu);
    if (slips) {
        noslip_slip_clear_f(&sums);            /* slip that goes on is noticed again, and lowers mu again */
    } else {
        next.uncertain_heading = self->noticed.uncertain_heading;
        next.uncertain_way = self->noticed.uncertain_way;
    }
    self->rate[0] = reading->angle[0] * now;
    self->rate[1] = reading->angle[1] * now;
    self->frequency = frequency;
    self->known = 1;
    noslip_slip_copy_f(&sums, &self->sums);
    noslip_noticed_copy_f(&next, &self->noticed);
    self->quiet = slips ? 0 : quiet;
    noslip_noticed_copy_f(&next, noticed);
    return slips || self->quiet < self->options.hold ? NOSLIP_SLIPPING : NOSLIP_OK;
}

/*
 * Writes to `grip` what a law, whose friction was `friction`, may use with the mu of the last step; `grip` is that of the law:
 *
 *     noslip_slip_grip(&slip, &options.friction, &law.grip);
 *
 * On an error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_BAD_PARAMETER for a friction that no law takes.
 */
static inline int noslip_slip_grip_f(const noslip_slip_f *self,
                          const noslip_friction_f *friction, noslip_grip_f *grip)
{
    noslip_friction_f believed;
    if (self == NULL || friction == NULL || grip == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!noslip_friction_ok_f(friction, 1)) {
        return NOSLIP_BAD_PARAMETER;
    }
    believed.margin = friction->margin;
    believed.share = friction->share;
    believed.height = friction->height;
    believed.mu = self->noticed.mu < friction->mu ? self->noticed.mu : friction->mu;
    *grip = noslip_grip_of_f(&believed);
    return NOSLIP_OK;
}

/* Forgets the uncertainty of dead reckoning, after the pose was corrected by a measured one. */
static inline int noslip_slip_trust_f(noslip_slip_f *self)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    self->noticed.uncertain_heading = self->noticed.uncertain_way = 0;
    return NOSLIP_OK;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
