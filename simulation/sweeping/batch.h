/*
 * batch.h - simulates many closed loops, each with its own numbers.
 *
 * A run is the same as in `noslip simulate` with a sampled controller: at each call the generated law receives the state (true, or
 * dead-reckoned from noisy sensors), its inputs act `delay` s later and are held, and the generated dynamics are integrated with
 * steps of constant length (Runge-Kutta, order 4, or 6 if the error is too large). Velocity-controlled drives are given commands
 * instead, as in drive.py. batch_law.h, generated for the law, defines the sizes of all arrays.
 */
#ifndef BATCH_H
#define BATCH_H

#include "batch_law.h"
#include "noslip_path.h"

/* Settings shared by all samples. */
typedef struct batch_settings {
    int corrected;                  /* 1: the dead-reckoned pose is corrected at intervals */
    int correction_mode;            /* NOSLIP_RESET or NOSLIP_BUMPLESS */
    int on_limit;                   /* NOSLIP_CUT, NOSLIP_SLOW or NOSLIP_GRIP */
    int reversing, stop, closed;    /* of a composite path, as in noslip_path_options */
    int segments;                   /* number of its segments */
    const BATCH_SEGMENT *path;
    int vectors;                    /* the longest vectors: 0 none, 1 those of every processor, 2 AVX2, 3 AVX-512 */
    double output_step;             /* s: between the instants at which the error is evaluated */
    double longest;                 /* s: first and longest step of the integrator */
    double accuracy;                /* largest integration error; a run that exceeds it is repeated, see `order` and `steps` */
    double band[BATCH_ROWS];        /* an output has settled if its error stays within */
    int instants;                   /* number of times in `instant` */
    const double *instant;          /* s, ascending: the outcomes contain the error at the first output time not before each */
} batch_settings;

/* One sample: all doubles, SI; vectors in the order of the law. */
typedef struct batch_sample {
    double refused;                 /* not 0: the status to return without a run */
    double plant[BATCH_PARAMETERS]; /* true parameters */
    double believed[BATCH_PARAMETERS];
    double config[BATCH_CONFIG + 1]; /* one more than needed, since C has no empty arrays; likewise below */
    double gains[BATCH_GAINS + 1];
    double limit[BATCH_INPUTS];     /* 0: none */
    double mu, margin, share, height; /* of the floor, see noslip_friction; mu 0: not known */
    double earned, known, error, coarse, lag; /* likewise; earned is the period */
    double ki[BATCH_INTEGRALS + 1];
    double integral_limit[BATCH_INTEGRALS + 1];
    double ko[BATCH_OBSERVERS + 1]; /* 1/s: rates of disturbance observers */
    double disturbance_limit[BATCH_OBSERVERS + 1];
    double offset[BATCH_REFERENCE]; /* reference: offset + slope t */
    double slope[BATCH_REFERENCE];
    double acceleration[BATCH_APPROACHES + 1], jerk[BATCH_APPROACHES + 1], settling; /* see noslip_approach_init */
    double start[BATCH_STATE];
    double extension[BATCH_EXTENSION + 1]; /* states of the law's dynamic extension at the start */
    double forward[2], turn[2], ahead; /* of the vehicle, as assumed by the controller; see noslip_odometry_options */
    double arm[2], true_arm[2];     /* m: of the vehicle's point ahead of its coordinates and to the left: believed, and true */
    double speed, deceleration, creep, L[2], W; /* of a composite path, see noslip_path_options */
    double lateral, along, angular; /* of its speed profile, see noslip_profile_limits; deceleration is that above */
    double omega, drive_delay;      /* 1/s, s: of velocity-controlled drives, see drive.py */
    double most_speed[BATCH_DOF], most_acceleration[BATCH_DOF], drive_band[BATCH_DOF]; /* see noslip_velocity_limits */
    double vehicle_along, vehicle_lateral; /* m/s^2, see noslip_velocity_vehicle; 0: no limits */
    double mean[BATCH_DOF], sd[BATCH_DOF]; /* rad/s: noise of the quasi-velocities */
    double seed;
    double sensor_period, counts, correction_rate, release;
    double true_ahead;              /* m: of the vehicle's point ahead of the axle, where slip is noticed */
    double gyro_noise, gyro_bias, acceleration_noise, acceleration_bias; /* of the readings */
    double window, wheel_noise, bias, geometry, deviations, least, lower, pause, rise, hold; /* see noslip_slip_options */
    double period, delay, duration;
} batch_sample;

/* Outcomes. In a row of outcomes they are followed by the error of each output at each of the instants. */
typedef struct batch_outcome {
    double status;                  /* NOSLIP_...: that of the last call, ARRIVED, or the reason of an early end */
    double t_end;                   /* s */
    double final[BATCH_ROWS];       /* y - y_d at the end */
    double peak[BATCH_ROWS];        /* largest |y - y_d| */
    double settling[BATCH_ROWS];    /* s: the last output time at which |y - y_d| was beyond the band; 0: never */
    double saturated;               /* s with this status; likewise the next three */
    double grip;
    double will_slip;
    double slipping;
    double use;                     /* largest friction use at any contact at an output time; 0 if mu is not known */
    double effort[BATCH_INPUTS];    /* largest absolute value of each input */
    double end[BATCH_STATE];        /* true state at the end */
    double integration_error;       /* estimate, of the largest component of the state */
    double steps;                   /* of the integrator in a period */
    double order;                   /* of the integrator's method: 4, or 6 if that was not enough */
} batch_outcome;

/* Values at one output time of a run. */
typedef struct batch_row {
    double t;
    double x[BATCH_STATE];
    double tau[BATCH_INPUTS];
    double error[BATCH_ROWS];
    double status;
    double piece;
} batch_row;

/* Runs `count` samples; `outcomes` has a row of `width` numbers for each. Threads share only data that is read. */
void batch_run(const batch_settings *settings, const batch_sample *samples, long count, double *outcomes, long width);

/* Returns the name of the vectors in which samples with these settings are run: plain, avx2 or avx512; or scalar. */
const char *batch_vectors(const batch_settings *settings);

/* Runs one sample and writes its rows, `most` at most. Returns the number of rows. */
long batch_trace(const batch_settings *settings, const batch_sample *sample, batch_row *rows, long most);

#endif
