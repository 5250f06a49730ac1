/*
 * batch.h - many closed loops, each with numbers of its own, run one after the other.
 *
 * A run is that of `noslip simulate` with a sampled controller: at each call the generated law sees the state (true, or sensed
 * with noise and dead-reckoned), what it answers acts `delay` s later and is held, and the generated dynamics are integrated
 * with steps of one length (Runge and Kutta, order 6). batch_law.h, made for the law, says how many numbers there are of what.
 */
#ifndef BATCH_H
#define BATCH_H

#include "batch_law.h"
#include "noslip_path.h"

/* What all samples share. */
typedef struct batch_settings {
    int corrected;                  /* 1: the dead-reckoned pose is set right now and then */
    int correction_mode;            /* NOSLIP_RESET or NOSLIP_BUMPLESS */
    int on_limit;                   /* NOSLIP_CUT or NOSLIP_SLOW */
    int reversing, stop, closed;    /* of a composite path, as in noslip_path_options */
    int segments;                   /* how many it has */
    const BATCH_SEGMENT *path;
    double output_step;             /* s: between the instants at which the error counts */
    double longest;                 /* s: the longest step of the integrator, tried first */
    double accuracy;                /* largest integration error; a run that exceeds it is repeated with shorter steps */
    double band[BATCH_ROWS];        /* the error of an output has settled within */
    int instants;                   /* how many times there are */
    const double *instant;          /* s, ascending: the outcomes tell the error at the first output time not before each */
} batch_settings;

/* One sample: all doubles, SI; vectors in the order of the law. */
typedef struct batch_sample {
    double refused;                 /* not 0: the status to answer; nothing is run */
    double plant[BATCH_PARAMETERS]; /* the truth */
    double believed[BATCH_PARAMETERS];
    double config[BATCH_CONFIG + 1]; /* one more than there are, for C has no empty arrays; the same holds for others */
    double gains[BATCH_GAINS + 1];
    double limit[BATCH_INPUTS];     /* 0: none */
    double ki[BATCH_INTEGRALS + 1];
    double integral_limit[BATCH_INTEGRALS + 1];
    double offset[BATCH_REFERENCE]; /* reference: offset + slope t */
    double slope[BATCH_REFERENCE];
    double start[BATCH_STATE];
    double forward[2], turn[2], ahead; /* of the vehicle, as believed; see noslip_odometry_options */
    double speed, deceleration, creep, L[2], W; /* of a composite path, see noslip_path_options */
    double mean[BATCH_FREEDOM], sd[BATCH_FREEDOM]; /* rad/s: noise of the quasi-velocities */
    double seed;
    double sensor_period, counts, correction_rate, release;
    double period, delay, duration;
} batch_sample;

/* What came of it. Behind these in a row of outcomes: for each output its error at each of the settings' instants. */
typedef struct batch_outcome {
    double status;                  /* NOSLIP_...: OK, SATURATED, ARRIVED, or why it ended before its time */
    double t_end;                   /* s */
    double final[BATCH_ROWS];       /* y - y_d at the end */
    double peak[BATCH_ROWS];        /* largest |y - y_d| */
    double settling[BATCH_ROWS];    /* s: the last output time at which |y - y_d| was beyond the band; 0: never */
    double saturated;               /* s */
    double effort[BATCH_INPUTS];    /* largest absolute value of each input */
    double end[BATCH_STATE];        /* true state at the end */
    double integration_error;       /* estimate, of the largest component of the state */
    double steps;                   /* of the integrator in a period */
} batch_outcome;

/* One output time, for who wants to see all of a run. */
typedef struct batch_row {
    double t;
    double x[BATCH_STATE];
    double tau[BATCH_INPUTS];
    double error[BATCH_ROWS];
    double status;
    double piece;
} batch_row;

/* Runs `count` samples; `outcomes` has a row of `width` numbers for each. Nothing is shared but what is read. */
void batch_run(const batch_settings *settings, const batch_sample *samples, long count, double *outcomes, long width);

/* Runs one sample and writes down its rows, `most` at most. Answers how many there are. */
long batch_trace(const batch_settings *settings, const batch_sample *sample, batch_row *rows, long most);

#endif
