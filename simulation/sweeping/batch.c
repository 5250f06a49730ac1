/*
 * batch.c - simulates many closed loops, see batch.h. Order and meaning of all steps are those of integrate.py and sensing.py.
 *
 * Runs whose controllers are called at the same times go together, as a team, one in each lane of vectors: lanes.inc integrates all
 * of them, and calls the law where nothing else belongs to the loop. What vectors cannot do is done here for one run after the other;
 * the bits are the same.
 */
#include "batch.h"

#include "lanes.h"
#include "noise.h"
#include "noslip_angle.h"
#include "noslip_approach.h"
#include "noslip_disturbance.h"
#include "noslip_integral.h"
#include "noslip_odometry.h"
#include "noslip_profile.h"
#include "noslip_slip.h"
#include "noslip_solve.h"
#include "noslip_velocity.h"

#define REPEATED 6       /* maximum number of repetitions of a run: with the method of order 6, then with half the step, five times */
#define CROSSING 1e-12   /* s: accuracy of the instant at which a run meets the singular set */
#define KNOWN 1e-9       /* s: its accuracy in the adaptive simulation */
#define SAFETY 4         /* factor on the sum of the errors of all calls, which may grow until the end */
#define WAITING LANES_WAITING
#define LATEST 16        /* maximum number of calls between two estimates of the integration error */
#define COMING 64        /* samples that wait for others with the same times */
#define TEAM (LANES_MOST * LANES_GROUPS) /* most runs of a team */

typedef struct BATCH_LAW() controller;
typedef struct BATCH_JUDGE() judge; /* the law in double for the true state, whatever the scalar of the controller */
typedef struct BATCH_PLANT() plant;
#if BATCH_DRIVE == 1
typedef struct BATCH_ROBOT(_dynamics) moved; /* what the torques of the controller cause, as it assumes */
#endif

/* Structs of scalars, and the same as arrays. */
typedef union { BATCH_ROBOT(_state) named; BATCH_REAL at[BATCH_STATE]; } seen_state;
typedef union { BATCH_JUDGE_ROBOT(_state) named; double at[BATCH_STATE]; } true_state;
typedef union { BATCH_LAW(_reference) named; BATCH_REAL at[BATCH_REFERENCE]; } reference_values;
typedef union { BATCH_JUDGE(_config) named; double at[BATCH_CONFIG + 1]; } config;

#define AS_MANY(name, type, number) typedef char name[sizeof(type) == sizeof(number) ? 1 : -1]
AS_MANY(states_are_scalars, BATCH_JUDGE_ROBOT(_state), ((true_state *)0)->at);
AS_MANY(references_are_scalars, BATCH_LAW(_reference), ((reference_values *)0)->at);
AS_MANY(outcomes_are_doubles, batch_outcome, double[9 + 3 * BATCH_ROWS + BATCH_INPUTS + BATCH_STATE + 1]);

#if BATCH_SENSED
/* The state that the controller receives instead of the true one. */
typedef struct sensing {
    BATCH_RUNTIME(noslip_odometry) odometry;
    double t, drawn, corrected;
    uint64_t draws;
    double angle[2], turned[2], noise[2]; /* true angle; angle with the accumulated noise; rad/s */
    double state[BATCH_STATE];
    int jumped; /* 1: the pose was corrected at once */
#if BATCH_NOTICES
    BATCH_RUNTIME(noslip_slip) slip;
    BATCH_RUNTIME(noslip_noticed) noticed;
    int slipping;          /* 1: slip was noticed a moment ago */
    int moved;             /* 1: `speed` is known */
    double pose[3], speed; /* true, at the last call and since the one before it */
    uint64_t readings;
#endif
} sensing;
#endif

/* One run. */
typedef struct loop {
    const batch_settings *settings;
    const batch_sample *sample;
    plant robot;
    controller law;
    judge believed, truth;   /* for the side of the singular set, and the true outputs */
    double sign;             /* of det Phi where the law was initialized */
    int fresh;               /* 1: the side of the singular set has not been determined yet */
    double x[BATCH_STATE];   /* true state */
#if BATCH_EXTENSION
    double extension[BATCH_EXTENSION]; /* states of the law's dynamic extension */
#endif
    double reference[BATCH_REFERENCE];
    int status;
    int over;                /* 1: the run has ended */
    double given[WAITING][BATCH_GIVEN], first[BATCH_GIVEN]; /* what the drives were given by the last calls, and before the first */
    int made;                /* 1: the law has been initialized since the lanes have its constants */
#if BATCH_DRIVE
    BATCH_RUNTIME(noslip_velocity) velocity;
#endif
#if BATCH_DRIVE == 1
    moved moves;
#endif
    int level;               /* how often the run has been repeated with a better method, or shorter steps */
    double step, error;      /* s; of the integrator, and its estimated error so far */
    double edge;             /* change of the state within the accuracy of the instant at which the run meets the singular set */
#if BATCH_SENSED
    sensing sensors;
#endif
#if BATCH_ROUTE
    BATCH_RUNTIME(noslip_path) path;
    BATCH_RUNTIME(noslip_guide) guide;
    int arrived, piece;
#if BATCH_PROFILE
    BATCH_RUNTIME(noslip_profile) profile;
    BATCH_REAL squares[BATCH_PROFILE];
#endif
    BATCH_REAL L;              /* m: of the present P_l, where approaches are advanced */
#endif
#if BATCH_APPROACHES
    BATCH_RUNTIME(noslip_approach) approach[BATCH_APPROACHES];
    double advanced;           /* s: when the approaches were */
#endif
#if BATCH_INTEGRALS
    BATCH_RUNTIME(noslip_integral) integral[BATCH_INTEGRALS];
#endif
#if BATCH_OBSERVERS
    BATCH_RUNTIME(noslip_disturbance) observer[BATCH_OBSERVERS];
    int observed;              /* the piece of the path at the last call */
#endif
    batch_outcome *outcome;
    double *errors;            /* errors at the settings' instants */
    int instant;
    batch_row *rows;
    long row_count, most_rows;
} loop;

/* Runs with the same times; without a kit, of one run. */
typedef struct team {
    const lanes_kit *kit;
    int count;
    loop *run;
    int unusual;             /* 1: the last call of a run had a status other than OK */
    int grounded;            /* 1: the floor of a run is known */
    int ended;               /* 1: a run has ended, which goes_on has not seen yet */
#if BATCH_LANES
    lanes_group lanes[LANES_GROUPS];
#endif
} team;

static const int reference_of_row[BATCH_ROWS] = BATCH_REFERENCE_OF_ROW;

static double least(double a, double b)
{
    return a < b ? a : b;
}

static int running(int status)
{
    return status == NOSLIP_OK || status == NOSLIP_SATURATED || status == NOSLIP_GRIP_LIMITED ||
        status == NOSLIP_WILL_SLIP || status == NOSLIP_SLIPPING;
}

static double number_of(uint64_t bits)
{
    noslip_bits made;
    made.bits = bits;
    return made.value;
}

static double not_a_number(void)
{
    return number_of(UINT64_C(0x7ff8000000000000));
}

#if BATCH_CONTACTS
static double infinite(void)
{
    return number_of(UINT64_C(0x7ff0000000000000));
}
#endif

/* The largest integer not above x, exact if it fits into 63 bits, else x. */
static double floor_of(double x)
{
    double whole;
    if (!(noslip_abs(x) < 4503599627370496.0)) {
        return x;
    }
    whole = (double)(int64_t)x;
    return whole > x ? whole - 1 : whole;
}

static double *copy(double *to, const double *from, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        to[i] = from[i];
    }
    return to;
}

static double largest(const double *x)
{
    double found = 0;
    int i;
    for (i = 0; i < BATCH_STATE; i++) {
        found = noslip_abs(x[i]) > found ? noslip_abs(x[i]) : found;
    }
    return found;
}

/* Returns the state that the controller receives. */
static const double *seen(const loop *self)
{
#if BATCH_SENSED
    return self->sensors.state;
#else
    return self->x;
#endif
}

static void as_seen(const double *x, seen_state *state)
{
    int i;
    for (i = 0; i < BATCH_STATE; i++) {
        state->at[i] = (BATCH_REAL)x[i];
    }
}

/* det Phi at a state, by elimination for large Phi; NaN if it is undefined. A damped law has no singular set to cross: 1. */
static double determinant(const judge *law, const double *x)
{
#if BATCH_DAMPED
    (void)law;
    (void)x;
    return 1;
#else
    double Phi[BATCH_DOF][BATCH_DOF];
    true_state state;
    copy(state.at, x, BATCH_STATE);
    if (BATCH_JUDGE(_decoupling)(law, &state.named, Phi) < 0) {
        return not_a_number();
    }
#if BATCH_DOF == 2
    return Phi[0][0] * Phi[1][1] - Phi[0][1] * Phi[1][0];
#else
    {
        double product = 1;
        int i, j, k;
        for (k = 0; k < BATCH_DOF; k++) {
            int pivot = k;
            for (i = k + 1; i < BATCH_DOF; i++) {
                pivot = noslip_abs(Phi[i][k]) > noslip_abs(Phi[pivot][k]) ? i : pivot;
            }
            for (j = k; j < BATCH_DOF; j++) {
                const double kept = Phi[k][j];
                Phi[k][j] = Phi[pivot][j];
                Phi[pivot][j] = kept;
            }
            product *= pivot == k ? Phi[k][k] : -Phi[k][k];
            for (i = k + 1; i < BATCH_DOF && noslip_abs(Phi[k][k]) > 0; i++) {
                const double factor = Phi[i][k] / Phi[k][k];
                for (j = k + 1; j < BATCH_DOF; j++) {
                    Phi[i][j] -= factor * Phi[k][j];
                }
            }
        }
        return product;
    }
#endif
#endif
}

/* Positive unless the singular set has been crossed since the law was initialized. */
static double side(const loop *self, const double *x)
{
    return self->sign * determinant(&self->believed, x);
}

/* Desired headings are those nearest to the estimated state. */
static void turn(loop *self)
{
#if BATCH_ANGLES
    static const int angle[BATCH_ANGLES] = BATCH_ANGLE_ROWS;
    double y[BATCH_ROWS];
    true_state state;
    int i;
    copy(state.at, seen(self), BATCH_STATE);
    if (BATCH_JUDGE(_output)(&self->believed, &state.named, y) < 0) {
        return;
    }
    for (i = 0; i < BATCH_ANGLES; i++) {
        double nearest, *prepared = &self->reference[reference_of_row[angle[i]]];
        if (noslip_nearest_angle(*prepared, y[angle[i]], &nearest) == NOSLIP_OK) {
            *prepared = nearest;
        }
    }
#else
    (void)self;
#endif
}

/* -- the controller's numbers ------------------------------------------------------------------------------------------ */

/* Hands the states of the dynamic extension to the law, and to the law in double that knows the singular set. */
static void extend(loop *self)
{
#if BATCH_EXTENSION
    int i;
    for (i = 0; i < BATCH_EXTENSION; i++) {
        self->law.extension[i] = (BATCH_REAL)self->extension[i];
        self->believed.extension[i] = self->extension[i];
    }
#else
    (void)self;
#endif
}

/* Calls the law. Its dynamic extension has been advanced. */
static int call(loop *self, const BATCH_ROBOT(_state) *state, const BATCH_LAW(_reference) *reference, BATCH_REAL *tau)
{
#if BATCH_EXTENSION
    extend(self);
    return BATCH_LAW(_step)(&self->law, state, reference, 0, tau);
#else
    return BATCH_LAW(_step)(&self->law, state, reference, tau);
#endif
}

/* Advances the states of the dynamic extension by a period, with the rates of the last call. */
static void advance(loop *self)
{
#if BATCH_EXTENSION
    int i;
    for (i = 0; i < BATCH_EXTENSION; i++) {
        self->extension[i] += self->sample->period * (double)self->law.extension_rate[i];
    }
#else
    (void)self;
#endif
}

/* Lets the law believe at first what the sample knows of friction. */
static void know(loop *self)
{
#if BATCH_CONTACTS
    self->law.earned.mu = (BATCH_REAL)self->sample->known;
#else
    (void)self;
#endif
}

/* Initializes the law of a path, for the controller and in double, with what it believes of friction. The present state determines the side of the singular set. */
static int make_law(loop *self, const double *where)
{
    const batch_sample *sample = self->sample;
    union { BATCH_ROBOT(_params) named; BATCH_REAL at[BATCH_PARAMETERS]; } params;
    union { BATCH_LAW(_config) named; BATCH_REAL at[BATCH_CONFIG + 1]; } where_seen;
    union { BATCH_LAW(_gains) named; BATCH_REAL at[BATCH_GAINS + 1]; } gains;
    union { BATCH_JUDGE_ROBOT(_params) named; double at[BATCH_PARAMETERS]; } exact;
    union { BATCH_JUDGE(_gains) named; double at[BATCH_GAINS + 1]; } exact_gains;
    BATCH_ROBOT(_options) options;
    config place;
    int i, status;
    options.on_error = NOSLIP_ZERO;
    options.on_limit = self->settings->on_limit;
#if BATCH_CONTACTS
    options.friction.mu = (BATCH_REAL)sample->mu;
    options.friction.margin = (BATCH_REAL)sample->margin;
    options.friction.share = (BATCH_REAL)sample->share;
    options.friction.height = (BATCH_REAL)sample->height;
    options.friction.period = (BATCH_REAL)sample->earned;
    options.friction.known = self->law.earned.mu;
    options.friction.error = (BATCH_REAL)sample->error;
    options.friction.coarse = (BATCH_REAL)sample->coarse;
    options.friction.lag = (BATCH_REAL)sample->lag;
#endif
    for (i = 0; i < BATCH_INPUTS; i++) {
        options.limit[i] = (BATCH_REAL)sample->limit[i];
    }
    for (i = 0; i < BATCH_PARAMETERS; i++) {
        params.at[i] = (BATCH_REAL)sample->believed[i];
    }
    for (i = 0; i < BATCH_CONFIG; i++) {
        where_seen.at[i] = (BATCH_REAL)where[i];
    }
    for (i = 0; i < BATCH_GAINS; i++) {
        gains.at[i] = (BATCH_REAL)sample->gains[i];
    }
    copy(place.at, where, BATCH_CONFIG);
    copy(exact_gains.at, sample->gains, BATCH_GAINS);
    status = BATCH_LAW(_init)(&self->law, &params.named, &where_seen.named, &gains.named, &options);
    if (status == NOSLIP_OK) {
        copy(exact.at, sample->believed, BATCH_PARAMETERS);
        status = BATCH_JUDGE(_init)(&self->believed, &exact.named, &place.named, &exact_gains.named, NULL);
    }
    if (status == NOSLIP_OK) {
        copy(exact.at, sample->plant, BATCH_PARAMETERS);
        status = BATCH_JUDGE(_init)(&self->truth, &exact.named, &place.named, &exact_gains.named, NULL);
    }
    if (status == NOSLIP_OK) {
        double found;
        extend(self);
        found = determinant(&self->believed, seen(self));
        self->sign = found > 0 ? 1 : found < 0 ? -1 : found;
        self->fresh = self->made = 1;
    }
    return status;
}

#if BATCH_ROUTE || BATCH_SENSED
static const int pose_coordinate[3] = BATCH_POSE;

/* Moves a pose by `side` (1 or -1) times an arm in its own axes: from the coordinates to the vehicle's point, or back. */
static void move_by_arm(double pose[3], const double arm[2], double side)
{
#if BATCH_ARM
    double sine, cosine;
    noslip_sincos(pose[2], &sine, &cosine);
    pose[0] += side * (arm[0] * cosine - arm[1] * sine);
    pose[1] += side * (arm[0] * sine + arm[1] * cosine);
#else
    (void)pose;
    (void)arm;
    (void)side;
#endif
}

/* Pose of the vehicle's point in a state. */
static void pose_of(const double *state, const double arm[2], double pose[3])
{
    int i;
    for (i = 0; i < 3; i++) {
        pose[i] = state[pose_coordinate[i]];
    }
    move_by_arm(pose, arm, 1);
}
#endif

#if BATCH_ROUTE
/* Estimated position of the vehicle, for the path. */
static void place_seen(const loop *self, BATCH_REAL place[4])
{
    const double *x = seen(self), *rates = x + BATCH_COORDINATES, *forward = self->sample->forward;
    double pose[3];
    int i;
    pose_of(x, self->sample->arm, pose);
    for (i = 0; i < 3; i++) {
        place[i] = (BATCH_REAL)pose[i];
    }
    place[3] = (BATCH_REAL)(forward[0] * rates[0] + forward[1] * rates[1]);
}

static void take_guide(loop *self)
{
    double *reference = self->reference;
    BATCH_REAL speed = self->guide.speed, speed_rate = self->guide.speed_rate;
    int i;
    for (i = 0; i < BATCH_REFERENCE; i++) {
        reference[i] = 0;
    }
#if BATCH_PROFILE
    {
        BATCH_REAL place[4];
        place_seen(self, place);
        (void)BATCH_RUNTIME(noslip_profile_speed)(&self->profile, &self->guide, place[3], &speed, &speed_rate);
    }
#endif
    reference[BATCH_SPEED] = speed;
#if BATCH_DRIVE == 2
    (void)speed_rate; /* a kinematic law does not have it */
#else
    reference[BATCH_SPEED + 1] = speed_rate;
#endif
}

/* Updates the path, and initializes the law for the current segment. Returns an error of the law, or OK. */
static int update(loop *self)
{
    BATCH_REAL place[4];
    config where;
    place_seen(self, place);
    (void)BATCH_RUNTIME(noslip_path_update)(&self->path, place[0], place[1], place[2], place[3], &self->guide);
    self->arrived = self->guide.arrived;
    if (!self->guide.changed) {
        return NOSLIP_OK;
    }
    self->piece = self->guide.segment;
    copy(where.at, self->sample->config, BATCH_CONFIG);
    where.named.L = self->guide.L;
    where.named.x_s = self->guide.x;
    where.named.y_s = self->guide.y;
    where.named.direction = self->guide.heading;
    where.named.curvature = self->guide.curvature;
    return make_law(self, where.at);
}

/* Starts the path at the true initial state. */
static int begin(loop *self)
{
    const batch_settings *settings = self->settings;
    const batch_sample *sample = self->sample;
    BATCH_RUNTIME(noslip_path_options) options = {0};
    BATCH_REAL place[4];
    int status;
    options.speed = (BATCH_REAL)sample->speed;
    options.deceleration = (BATCH_REAL)sample->deceleration;
    options.creep = (BATCH_REAL)sample->creep;
    options.L[0] = (BATCH_REAL)sample->L[0];
    options.L[1] = (BATCH_REAL)sample->L[1];
    options.W = (BATCH_REAL)sample->W;
    options.ahead = (BATCH_REAL)sample->ahead;
    options.reversing = settings->reversing;
    options.stop = settings->stop;
    options.closed = settings->closed;
    status = BATCH_RUNTIME(noslip_path_init)(&self->path, settings->path, settings->segments, &options, NULL);
    if (status < 0) {
        return status;
    }
    know(self);
    place_seen(self, place);
    status = BATCH_RUNTIME(noslip_path_look)(&self->path, place[0], place[1], place[2], place[3], &self->guide);
#if BATCH_PROFILE
    if (status >= 0) {
        BATCH_RUNTIME(noslip_profile_limits) limits;
        limits.lateral = (BATCH_REAL)sample->lateral;
        limits.acceleration = (BATCH_REAL)sample->along;
        limits.deceleration = (BATCH_REAL)sample->deceleration;
        limits.angular = (BATCH_REAL)sample->angular;
        limits.behind = BATCH_RUNTIME(noslip_abs)(self->guide.foot.distance) - self->guide.progress;
        if (options.stop == NOSLIP_STOP_AXLE) {
            limits.behind += BATCH_RUNTIME(noslip_abs)(options.L[settings->path[0].backward != 0] + options.ahead);
        }
        limits.behind = limits.behind > 0 ? limits.behind : 0;
        status = BATCH_RUNTIME(noslip_profile_init)(&self->profile, settings->path, settings->segments, &options, &limits,
                                                    self->squares);
    }
#endif
    return status < 0 ? status : update(self);
}

/* The reference given by the path at the estimated state. */
static void desire(loop *self, double t)
{
    BATCH_REAL place[4];
    (void)t;
    place_seen(self, place);
    (void)BATCH_RUNTIME(noslip_path_look)(&self->path, place[0], place[1], place[2], place[3], &self->guide);
    take_guide(self);
}
#else
static int begin(loop *self)
{
    know(self);
    return make_law(self, self->sample->config);
}

static int update(loop *self)
{
    (void)self;
    return NOSLIP_OK;
}

/* The reference at a time. */
static void desire(loop *self, double t)
{
    int i;
    for (i = 0; i < BATCH_REFERENCE; i++) {
        self->reference[i] = self->sample->offset[i] + self->sample->slope[i] * t;
    }
    turn(self);
}
#endif

#if BATCH_APPROACHES
static const int led_row[BATCH_APPROACHES] = BATCH_LED_ROWS; /* outputs of relative degree 2, and of 1; -1: none */
static const int led_speed[BATCH_APPROACHES] = BATCH_LED_SPEEDS;

/* Adds what the approaches say to the reference. */
static void add_lead(loop *self)
{
    int i;
    for (i = 0; i < BATCH_APPROACHES; i++) {
        BATCH_RUNTIME(noslip_approached) *desired = &self->approach[i].desired;
        if (led_row[i] >= 0) {
            double *entry = &self->reference[reference_of_row[led_row[i]]];
            entry[0] += (double)desired->distance;
            entry[1] += (double)desired->distance_rate;
            entry[2] += (double)desired->distance_acceleration;
        }
        if (led_speed[i] >= 0) {
            double *entry = &self->reference[reference_of_row[led_speed[i]]];
            entry[0] = (double)desired->speed;
            entry[1] = (double)desired->speed_rate;
        }
    }
    turn(self);
}

/* Begins the approaches at the estimated state. */
static int begin_lead(loop *self, double t)
{
    double y[BATCH_ROWS], ydot[BATCH_ROWS];
    true_state state;
    int i, status;
    copy(state.at, seen(self), BATCH_STATE);
    status = BATCH_JUDGE(_output)(&self->believed, &state.named, y);
    if (status >= 0) {
        status = BATCH_JUDGE(_rate)(&self->believed, &state.named, ydot);
    }
    desire(self, t);
    for (i = 0; i < BATCH_APPROACHES && status >= 0; i++) { /* the rates are those of the outputs that are led, in their order */
        const int row = led_row[i], speed = led_speed[i];
        const double *entry = row >= 0 ? &self->reference[reference_of_row[row]] : NULL;
        status = BATCH_RUNTIME(noslip_approach_start)(&self->approach[i], entry ? (BATCH_REAL)(y[row] - entry[0]) : 0,
                                                      entry ? (BATCH_REAL)(ydot[i] - entry[1]) : 0,
                                                      speed >= 0 ? (BATCH_REAL)y[speed] : 0);
    }
    self->advanced = t;
    return status;
}

/* Advances the approaches to a time, or begins them where P_l has changed sides or the pose has jumped. */
static int lead(loop *self, double t)
{
    int i, status = NOSLIP_OK;
#if BATCH_SENSED
    int anew = self->sensors.jumped;
#else
    int anew = 0;
#endif
#if BATCH_ROUTE
    anew = anew || noslip_abs((double)(self->guide.L - self->L)) > 0;
    self->L = self->guide.L;
#endif
    if (anew) {
        status = begin_lead(self, t);
    }
    desire(self, t);
    for (i = 0; i < BATCH_APPROACHES && status >= 0; i++) {
        const double *entry = led_speed[i] >= 0 ? &self->reference[reference_of_row[led_speed[i]]] : NULL;
        const BATCH_REAL speed = entry ? (BATCH_REAL)entry[0] : 0;
        BATCH_RUNTIME(noslip_approached) desired;
        status = BATCH_RUNTIME(noslip_approach_step)(&self->approach[i], (BATCH_REAL)(t - self->advanced), speed, &desired);
#if BATCH_ROUTE
        if (status >= 0) {
            status = BATCH_RUNTIME(noslip_approach_within)(&self->approach[i], speed, entry ? (BATCH_REAL)entry[1] : 0, &desired);
        }
#endif
    }
    self->advanced = t;
    return status;
}

/* Initializes the approaches and begins them at the true initial state. */
static int init_lead(loop *self)
{
    int i, status = NOSLIP_OK;
    for (i = 0; i < BATCH_APPROACHES && status >= 0; i++) {
        status = BATCH_RUNTIME(noslip_approach_init)(&self->approach[i], (BATCH_REAL)self->sample->acceleration[i],
                                                     (BATCH_REAL)self->sample->settling, (BATCH_REAL)self->sample->jerk[i]);
    }
#if BATCH_ROUTE
    self->L = self->guide.L;
#endif
    return status < 0 ? status : begin_lead(self, 0);
}
#else
static void add_lead(loop *self)
{
    (void)self;
}

static int lead(loop *self, double t)
{
    (void)self;
    (void)t;
    return NOSLIP_OK;
}

static int init_lead(loop *self)
{
    (void)self;
    return NOSLIP_OK;
}
#endif

/* The speed along a path is less where slip was noticed. */
static void slow_down(loop *self)
{
#if BATCH_NOTICES && BATCH_SPEED >= 0
    self->reference[BATCH_SPEED] *= self->sensors.noticed.slower;
    self->reference[BATCH_SPEED + 1] *= self->sensors.noticed.slower;
#else
    (void)self;
#endif
}

/* The reference at a time, for the estimated state. */
static void look(loop *self, double t)
{
    desire(self, t);
    add_lead(self);
    slow_down(self);
}

#if BATCH_INTEGRALS
static const int row_of_integral[BATCH_INTEGRALS] = BATCH_INTEGRAL_ROWS;

/* Adds the integral action to the highest derivatives desired of each row; `all` is NULL if the law has an error. Desired headings
 * are already those nearest to the state. */
static int integrate(loop *self, const BATCH_LAW(_evaluation) *all, double desired[BATCH_ROWS])
{
    int i;
    for (i = 0; i < BATCH_INTEGRALS; i++) {
        const int row = row_of_integral[i];
        const double error = all ? self->reference[reference_of_row[row]] - all->h[row] : 0;
        BATCH_REAL added;
        int status;
        status = BATCH_RUNTIME(noslip_integral_step)(&self->integral[i], (BATCH_REAL)error,
                                                     (BATCH_REAL)self->sample->period, self->status, &added);
        if (status < 0) {
            return status;
        }
        desired[row] += added;
    }
    return NOSLIP_OK;
}
#endif

#if BATCH_OBSERVERS
static const int row_of_observer[BATCH_OBSERVERS] = BATCH_OBSERVER_ROWS;
static const int rate_of_observer[BATCH_OBSERVERS] = BATCH_OBSERVER_RATES; /* where ydot has that of the row; -1: degree 1 */
static const int gain_of_observer[BATCH_OBSERVERS] = BATCH_OBSERVER_GAINS; /* the first of the row */

/* Adds minus the estimates of disturbances; see integrate. */
static int observe(loop *self, const BATCH_LAW(_evaluation) *all, double desired[BATCH_ROWS])
{
    int i, before = self->status;
#if BATCH_ROUTE
    before = self->piece == self->observed ? before : NOSLIP_SATURATED; /* another output: nothing to compare with */
    self->observed = self->piece;
#endif
    for (i = 0; i < BATCH_OBSERVERS; i++) {
        const int row = row_of_observer[i];
        const double *wanted = &self->reference[reference_of_row[row]], *gain = &self->sample->gains[gain_of_observer[i]];
        double measured = 0, v = 0;
        BATCH_REAL added;
        int status;
        if (all) {
            measured = all->h[row];
            v = gain[0] * (wanted[0] - measured);
#if BATCH_RATES
            if (rate_of_observer[i] >= 0) {
                measured = all->ydot[rate_of_observer[i]];
                v += gain[1] * (wanted[1] - measured);
            }
#endif
            v += desired[row];
        }
        status = BATCH_RUNTIME(noslip_disturbance_step)(&self->observer[i], (BATCH_REAL)measured, (BATCH_REAL)v,
                                                        (BATCH_REAL)self->sample->period, before, &added);
        if (status < 0) {
            return status;
        }
        desired[row] += added;
    }
    return NOSLIP_OK;
}
#endif

#if BATCH_INTEGRALS || BATCH_OBSERVERS
/* Adds what acts beside the law to the reference that it receives. */
static int act_beside(loop *self, const seen_state *state, reference_values *reference)
{
    static const int highest[BATCH_ROWS] = BATCH_HIGHEST;
    BATCH_LAW(_evaluation) found;
    const BATCH_LAW(_evaluation) *all =
        BATCH_LAW(_evaluate)(&self->law, &state->named, &reference->named, &found) == NOSLIP_OK ? &found : NULL;
    double desired[BATCH_ROWS];
    int row, status = NOSLIP_OK;
    for (row = 0; row < BATCH_ROWS; row++) {
        desired[row] = self->reference[highest[row]];
    }
#if BATCH_INTEGRALS
    status = integrate(self, all, desired);
#endif
#if BATCH_OBSERVERS
    status = status < 0 ? status : observe(self, all, desired);
#endif
    for (row = 0; row < BATCH_ROWS; row++) {
        reference->at[highest[row]] = (BATCH_REAL)desired[row];
    }
    return status;
}
#endif

#if BATCH_DRIVE
/* Makes the commands of the drives from the answer of the law. Returns the status. */
static int drive(loop *self, const seen_state *state, int status, const BATCH_REAL answer[BATCH_ANSWER], double given[BATCH_GIVEN])
{
    const BATCH_REAL *nu = state->at + BATCH_COORDINATES;
    BATCH_REAL commanded[BATCH_DOF];
    int i;
#if BATCH_DRIVE == 1
    BATCH_REAL qdot[BATCH_COORDINATES], u[BATCH_DOF];
    const int caused = BATCH_ROBOT(_dynamics_acceleration)(&self->moves, &state->named, answer, qdot, u);
    status = BATCH_RUNTIME(noslip_velocity_step)(&self->velocity, u, nu, caused == NOSLIP_OK ? status : caused,
                                                 (BATCH_REAL)self->sample->period, commanded);
    for (i = 0; i < BATCH_INPUTS; i++) {
        given[BATCH_DOF + i] = (double)answer[i];
    }
#else
    status = BATCH_RUNTIME(noslip_velocity_follow)(&self->velocity, answer, nu, status, (BATCH_REAL)self->sample->period, commanded);
    for (i = 0; i < BATCH_INPUTS; i++) {
        given[BATCH_DOF + i] = 0;
    }
#endif
    for (i = 0; i < BATCH_DOF; i++) {
        given[i] = (double)commanded[i];
    }
    return status;
}
#endif

/* Initializes the drives, which hold the velocities of the start. */
static int init_drives(loop *self, double given[BATCH_GIVEN])
{
    int i, status = NOSLIP_OK;
#if BATCH_DRIVE
    const batch_sample *sample = self->sample;
    BATCH_RUNTIME(noslip_velocity_limits) limits[BATCH_DOF];
    BATCH_REAL nu[BATCH_DOF];
#endif
#if BATCH_DRIVE == 1
    union { BATCH_ROBOT(_params) named; BATCH_REAL at[BATCH_PARAMETERS]; } params;
    for (i = 0; i < BATCH_PARAMETERS; i++) {
        params.at[i] = (BATCH_REAL)sample->believed[i];
    }
    status = BATCH_ROBOT(_dynamics_init)(&self->moves, &params.named);
#endif
    for (i = 0; i < BATCH_GIVEN; i++) {
        given[i] = 0;
    }
#if BATCH_DRIVE
    for (i = 0; i < BATCH_DOF; i++) {
        limits[i].speed = (BATCH_REAL)sample->most_speed[i];
        limits[i].acceleration = (BATCH_REAL)sample->most_acceleration[i];
        limits[i].band = (BATCH_REAL)sample->drive_band[i];
        given[i] = self->x[BATCH_COORDINATES + i];
        nu[i] = (BATCH_REAL)given[i];
    }
    if (status >= 0) {
        status = BATCH_RUNTIME(noslip_velocity_init)(&self->velocity, limits, BATCH_DOF, (BATCH_REAL)sample->period);
    }
    if (status >= 0 && sample->vehicle_along > 0) {
        BATCH_RUNTIME(noslip_velocity_vehicle) vehicle;
        for (i = 0; i < 2; i++) {
            vehicle.forward[i] = (BATCH_REAL)sample->forward[i];
            vehicle.turn[i] = (BATCH_REAL)sample->turn[i];
        }
        vehicle.along = (BATCH_REAL)sample->vehicle_along;
        vehicle.lateral = (BATCH_REAL)sample->vehicle_lateral;
        status = BATCH_RUNTIME(noslip_velocity_set_vehicle)(&self->velocity, &vehicle);
    }
    if (status >= 0) {
        status = BATCH_RUNTIME(noslip_velocity_reset)(&self->velocity, nu);
    }
#else
    (void)self;
#endif
    return status;
}

/* Calls the controller at time t: stores its status and what the drives are given. */
static int command(loop *self, double t, double given[BATCH_GIVEN])
{
    BATCH_REAL answer[BATCH_ANSWER];
    seen_state state;
    reference_values reference;
    int i, status;
#if BATCH_ROUTE
    (void)t;
    take_guide(self);
    add_lead(self);
    slow_down(self);
#else
    look(self, t);
#endif
    as_seen(seen(self), &state);
    for (i = 0; i < BATCH_REFERENCE; i++) {
        reference.at[i] = (BATCH_REAL)self->reference[i];
    }
#if BATCH_INTEGRALS || BATCH_OBSERVERS
    status = act_beside(self, &state, &reference);
    if (status < 0) {
        return self->status = status;
    }
#endif
#if BATCH_NOTICES
    status = BATCH_RUNTIME(noslip_slip_grip)(&self->sensors.slip, &self->law.earned, &self->law.grip);
    if (status < 0) {
        return self->status = status;
    }
#endif
    status = call(self, &state.named, &reference.named, answer);
    /* a true state has been checked when it was reached */
    if (running(status) && (BATCH_SENSED || self->fresh)) {
        self->fresh = 0;
        status = side(self, seen(self)) <= 0 ? NOSLIP_SINGULAR : status;
    }
#if BATCH_NOTICES
    status = running(status) && self->sensors.slipping ? NOSLIP_SLIPPING : status;
#endif
#if BATCH_DRIVE
    status = drive(self, &state, status, answer, given);
#else
    for (i = 0; i < BATCH_INPUTS; i++) {
        given[i] = running(status) ? (double)answer[i] : 0;
    }
#endif
    return self->status = status;
}

/* -- the sensors ------------------------------------------------------------------------------------------------------- */

#if BATCH_SENSED
static const int wheel_coordinate[2] = BATCH_WHEELS;

/* Number of elapsed periods; with period 0 every instant counts. */
static double periods(double t, double period)
{
    return period > 0 ? floor_of(t / period + 1e-9) : t;
}

static void draw(sensing *self, const batch_sample *sample)
{
    double normal[2] = {0, 0};
    int i;
    if (sample->sd[0] > 0 || sample->sd[1] > 0) {
        noise_normal((uint64_t)sample->seed, self->draws, 2, normal);
    }
    self->draws++;
    for (i = 0; i < 2; i++) {
        self->noise[i] = sample->mean[i] + sample->sd[i] * normal[i];
    }
}

/* The angle of a wheel as measured by its encoder. */
static double counted(double turned, double counts)
{
    const double step = counts > 0 ? 6.283185307179586 / counts : 0;
    return counts > 0 ? floor_of(turned / step) * step : turned;
}

static BATCH_RUNTIME(noslip_pose) true_pose(const loop *self)
{
    BATCH_RUNTIME(noslip_pose) pose;
    double place[3];
    pose_of(self->x, self->sample->true_arm, place);
    pose.x = (BATCH_REAL)place[0];
    pose.y = (BATCH_REAL)place[1];
    pose.heading = (BATCH_REAL)place[2];
    return pose;
}

/* Initially the estimated state is the true one. */
static void show_truth(loop *self)
{
    copy(self->sensors.state, self->x, BATCH_STATE);
}

#if BATCH_NOTICES
static int notice_first(loop *self)
{
    const batch_sample *sample = self->sample;
    sensing *sensors = &self->sensors;
    BATCH_RUNTIME(noslip_slip_options) options;
    BATCH_RUNTIME(noslip_odometry_options) vehicle;
    int i;
    options.window = (BATCH_REAL)sample->window;
    options.wheel_noise = (BATCH_REAL)sample->wheel_noise;
    options.gyro_noise = (BATCH_REAL)sample->gyro_noise;
    options.gyro_bias = (BATCH_REAL)sample->bias;
    options.acceleration_noise = (BATCH_REAL)sample->acceleration_noise;
    options.acceleration_bias = (BATCH_REAL)sample->acceleration_bias;
    options.geometry = (BATCH_REAL)sample->geometry;
    options.deviations = (BATCH_REAL)sample->deviations;
    options.mu = (BATCH_REAL)sample->mu;
    options.least = (BATCH_REAL)sample->least;
    options.lower = (BATCH_REAL)sample->lower;
    options.pause = (BATCH_REAL)sample->pause;
    options.rise = (BATCH_REAL)sample->rise;
    options.hold = (BATCH_REAL)sample->hold;
    for (i = 0; i < 2; i++) {
        options.count[i] = (BATCH_REAL)(sample->counts > 0 ? 6.283185307179586 / sample->counts : 0);
        vehicle.forward[i] = (BATCH_REAL)sample->forward[i];
        vehicle.turn[i] = (BATCH_REAL)sample->turn[i];
    }
    vehicle.ahead = vehicle.release = 0;
    pose_of(self->x, sample->true_arm, sensors->pose);
    sensors->speed = 0;
    sensors->readings = 0;
    sensors->moved = sensors->slipping = 0;
    i = BATCH_RUNTIME(noslip_slip_init)(&sensors->slip, &options, &vehicle);
    sensors->noticed = sensors->slip.noticed;
    return i;
}

/* The true mean speed of the middle of the axle on the way to a pose. */
static double mean_speed(const double *before, const double *after, double ahead, double dt)
{
    double sine[3], cosine[3];
    noslip_sincos(before[2], &sine[0], &cosine[0]);
    noslip_sincos(after[2], &sine[1], &cosine[1]);
    noslip_sincos((before[2] + after[2]) / 2, &sine[2], &cosine[2]);
    return (cosine[2] * (after[0] - before[0] - ahead * (cosine[1] - cosine[0])) +
            sine[2] * (after[1] - before[1] - ahead * (sine[1] - sine[0]))) / dt;
}

/* Compares gyro and accelerometer with the angles by which the wheels moved. */
static int notice(loop *self, const BATCH_REAL *moved, double dt)
{
    const batch_sample *sample = self->sample;
    sensing *sensors = &self->sensors;
    BATCH_RUNTIME(noslip_slip_reading) reading;
    double normal[2], pose[3], speed;
    int status;
    noise_normal((uint64_t)sample->seed + (UINT64_C(1) << 63), sensors->readings, 2, normal);
    sensors->readings++;
    pose_of(self->x, sample->true_arm, pose);
    speed = mean_speed(sensors->pose, pose, sample->true_ahead, dt);
    reading.angle[0] = moved[0];
    reading.angle[1] = moved[1];
    reading.yaw_rate = (BATCH_REAL)((pose[2] - sensors->pose[2]) / dt + sample->gyro_bias + sample->gyro_noise * normal[0]);
    reading.acceleration = (BATCH_REAL)((sensors->moved ? (speed - sensors->speed) / dt : 0) + sample->acceleration_bias +
                                        sample->acceleration_noise * normal[1]);
    reading.accelerates = BATCH_ACCELERATES;
    copy(sensors->pose, pose, 3);
    sensors->speed = speed;
    sensors->moved = 1;
    status = BATCH_RUNTIME(noslip_slip_step)(&sensors->slip, &reading, (BATCH_REAL)dt, &sensors->noticed);
    sensors->slipping = status == NOSLIP_SLIPPING;
    return status;
}
#endif

#if BATCH_RECKONED
/* Sets the coordinates of the estimated state to a pose of the vehicle's point. */
static void show_pose(sensing *sensors, const batch_sample *sample, const BATCH_RUNTIME(noslip_pose) *pose)
{
    double place[3];
    int i;
    place[0] = (double)pose->x;
    place[1] = (double)pose->y;
    place[2] = (double)pose->heading;
    move_by_arm(place, sample->arm, -1);
    for (i = 0; i < 3; i++) {
        sensors->state[pose_coordinate[i]] = place[i];
    }
}
#endif

static int sense_first(loop *self)
{
    const batch_sample *sample = self->sample;
    sensing *sensors = &self->sensors;
    const BATCH_RUNTIME(noslip_pose) pose = true_pose(self);
    BATCH_RUNTIME(noslip_odometry_options) options;
    int i;
    for (i = 0; i < 2; i++) {
        options.forward[i] = (BATCH_REAL)sample->forward[i];
        options.turn[i] = (BATCH_REAL)sample->turn[i];
        sensors->angle[i] = sensors->turned[i] = self->x[wheel_coordinate[i]];
    }
    options.ahead = (BATCH_REAL)sample->ahead;
    options.release = (BATCH_REAL)sample->release;
    sensors->t = sensors->drawn = sensors->corrected = 0;
    sensors->draws = 0;
    draw(sensors, sample);
    for (i = 0; i < 2; i++) {
        sensors->state[BATCH_COORDINATES + i] += sensors->noise[i];
    }
#if BATCH_RECKONED && BATCH_ARM
    show_pose(sensors, sample, &pose);
#endif
#if BATCH_NOTICES
    i = notice_first(self);
    if (i < 0) {
        return i;
    }
#endif
    return BATCH_RUNTIME(noslip_odometry_init)(&sensors->odometry, &options, &pose);
}

static int sense(loop *self, double t)
{
    const batch_sample *sample = self->sample;
    sensing *sensors = &self->sensors;
    const double dt = t - sensors->t;
    BATCH_RUNTIME(noslip_pose) pose;
    BATCH_REAL moved_seen[2];
    double moved[2], now;
    int i, status;
    sensors->t = t;
    sensors->jumped = 0;
    if (!(dt > 0)) {
        return NOSLIP_OK;
    }
    for (i = 0; i < 2; i++) {
        const double angle = self->x[wheel_coordinate[i]], before = counted(sensors->turned[i], sample->counts);
        sensors->turned[i] += angle - sensors->angle[i] + sensors->noise[i] * dt;
        sensors->angle[i] = angle;
        moved[i] = counted(sensors->turned[i], sample->counts) - before;
        moved_seen[i] = (BATCH_REAL)moved[i];
    }
    if (noslip_abs(sensors->state[pose_coordinate[2]]) > 4) { /* UNWIND of simulation/sensing.py */
        (void)BATCH_RUNTIME(noslip_odometry_unwind)(&sensors->odometry);
    }
    status = BATCH_RUNTIME(noslip_odometry_move)(&sensors->odometry, moved_seen, (BATCH_REAL)dt, &pose);
#if BATCH_NOTICES
    status = status < 0 ? status : notice(self, moved_seen, dt);
#endif
    now = status >= 0 && self->settings->corrected ? periods(t, 1 / sample->correction_rate) : 0;
    if (now > sensors->corrected) {
        BATCH_RUNTIME(noslip_pose) truth = true_pose(self);
        double heading;
        sensors->corrected = now;
        sensors->jumped = self->settings->correction_mode == NOSLIP_RESET;
        status = noslip_nearest_angle(self->x[pose_coordinate[2]], (double)pose.heading, &heading);
        truth.heading = (BATCH_REAL)heading;
        status = status < 0 ? status : BATCH_RUNTIME(noslip_odometry_correct)(&sensors->odometry, &truth, self->settings->correction_mode);
        if (status >= 0) {
            status = BATCH_RUNTIME(noslip_odometry_pose)(&sensors->odometry, &pose);
        }
#if BATCH_NOTICES
        status = status < 0 ? status : BATCH_RUNTIME(noslip_slip_trust)(&sensors->slip);
#endif
    }
    if (status < 0) {
        return status;
    }
    now = periods(t, sample->sensor_period);
    if (now > sensors->drawn) {
        draw(sensors, sample);
        sensors->drawn = now;
    }
    copy(sensors->state, self->x, BATCH_STATE);
#if BATCH_RECKONED
    show_pose(sensors, sample, &pose);
#endif
    for (i = 0; i < 2; i++) {
        const double rate = self->x[BATCH_COORDINATES + i];
        sensors->state[wheel_coordinate[i]] = counted(sensors->turned[i], sample->counts);
        sensors->state[BATCH_COORDINATES + i] = sample->counts > 0 ? moved[i] / dt : rate + sensors->noise[i];
    }
    return NOSLIP_OK;
}
#else
static void show_truth(loop *self)
{
    (void)self;
}

static int sense_first(loop *self)
{
    (void)self;
    return NOSLIP_OK;
}

static int sense(loop *self, double t)
{
    (void)self;
    (void)t;
    return NOSLIP_OK;
}
#endif

/* -- the robot --------------------------------------------------------------------------------------------------------- */

#if BATCH_DRIVE
/* The rates of the state with drives whose loop follows the commands. */
static int rate(const loop *self, const double *x, const double *given, double *xdot)
{
    static const double none[BATCH_INPUTS] = {0};
    const batch_sample *sample = self->sample;
    double *nudot = xdot + BATCH_COORDINATES;
    true_state state;
    int i, status;
    copy(state.at, x, BATCH_STATE);
    status = BATCH_PLANT(_acceleration)(&self->robot, &state.named, BATCH_FEEDS ? given + BATCH_DOF : none, xdot, nudot);
    for (i = 0; i < BATCH_DOF; i++) {
        const double made = (BATCH_FEEDS ? nudot[i] : 0) + sample->omega * (given[i] - x[BATCH_COORDINATES + i]);
        nudot[i] = noslip_clip(made, sample->most_acceleration[i]);
    }
    return status;
}

/* The torques with which the drives cause these rates: S'E tau = S'MS nudot + bias (12). */
static void torques(const loop *self, const double *x, const double *given, double tau[BATCH_INPUTS])
{
    BATCH_PLANT(_evaluation) all;
    double force[BATCH_DOF], xdot[BATCH_STATE];
    const double *nudot = xdot + BATCH_COORDINATES;
    true_state state;
    int i, j, good, order[BATCH_DOF];
    copy(state.at, x, BATCH_STATE);
    good = rate(self, x, given, xdot) == NOSLIP_OK &&
           BATCH_PLANT(_evaluate)(&self->robot, &state.named, &all) == NOSLIP_OK &&
           noslip_invert(all.input_map[0], order, BATCH_DOF) > 0;
    for (i = 0; good && i < BATCH_DOF; i++) {
        force[i] = all.bias[i];
        for (j = 0; j < BATCH_DOF; j++) {
            force[i] += all.Mbar[i][j] * nudot[j];
        }
    }
    for (i = 0; i < BATCH_INPUTS; i++) {
        tau[i] = good ? 0 : not_a_number();
        for (j = 0; good && j < BATCH_DOF; j++) {
            tau[i] += all.input_map[i][j] * force[j];
        }
    }
}
#else
static int rate(const loop *self, const double *x, const double *tau, double *xdot)
{
    true_state state;
    copy(state.at, x, BATCH_STATE);
    return BATCH_PLANT(_acceleration)(&self->robot, &state.named, tau, xdot, xdot + BATCH_COORDINATES);
}

static void torques(const loop *self, const double *x, const double *given, double tau[BATCH_INPUTS])
{
    (void)self;
    (void)x;
    copy(tau, given, BATCH_INPUTS);
}
#endif

/* The method with which a run is integrated. */
static int method_of(const loop *self)
{
    return self->level > 0;
}

/* The state h seconds later, by one step. */
static int step(const loop *self, const double *x, const double *tau, double h, double *after)
{
    const batch_method *method = &batch_methods[method_of(self)];
    double slope[BATCH_STAGES][BATCH_STATE], sum[BATCH_STATE];
    int i, j, k, status;
    copy(after, x, BATCH_STATE);
    for (k = 0; k < method->stages; k++) {
        const double *share = method->share[k + 1];
        status = rate(self, after, tau, slope[k]);
        if (status < 0) {
            return status;
        }
        for (i = 0; i < BATCH_STATE; i++) {
            sum[i] = share[0] * slope[0][i];
        }
        for (j = 1; j <= k; j++) {
            for (i = 0; i < BATCH_STATE; i++) {
                sum[i] += share[j] * slope[j][i];
            }
        }
        for (i = 0; i < BATCH_STATE; i++) {
            after[i] = x[i] + h * sum[i];
        }
    }
    return noslip_all_finite(after, BATCH_STATE) ? NOSLIP_OK : NOSLIP_NONFINITE;
}

/* The time from x, s, at which a step of h crosses the singular set; `after` is the state just after it. */
static double crossing(const loop *self, const double *x, const double *tau, double h, double *after)
{
    double before = 0, tried[BATCH_STATE];
    while (h - before > CROSSING) {
        const double middle = before + (h - before) / 2;
        if (step(self, x, tau, middle, tried) == NOSLIP_OK && side(self, tried) > 0) {
            before = middle;
        } else {
            h = middle;
        }
    }
    (void)step(self, x, tau, h, after);
    return h;
}

/*
 * Integrates x for `duration` seconds with constant inputs, in `count` steps; `gone` is the time that was reached (s). Returns
 * NOSLIP_SINGULAR if a controller that receives the true state crosses the singular set.
 */
static int go(const loop *self, double *x, const double *tau, double duration, int count, double *gone)
{
    const double h = duration / count;
    double after[BATCH_STATE];
    int i, status;
    for (i = 0; i < count; i++) {
        *gone = i * h;
        status = step(self, x, tau, h, after);
        if (status < 0) {
            return NOSLIP_NONFINITE;
        }
        if (!BATCH_SENSED && side(self, after) <= 0) {
            *gone += crossing(self, x, tau, h, after);
            copy(x, after, BATCH_STATE);
            return NOSLIP_SINGULAR;
        }
        copy(x, after, BATCH_STATE);
    }
    *gone = duration;
    return NOSLIP_OK;
}

/* The number of steps of the integrator in `duration` seconds. */
static int steps_of(const loop *self, double duration)
{
    const int count = (int)floor_of(duration / self->step + 1 - 1e-9);
    return count > 1 ? count : 1;
}

/* As `go`; if `weight` is not 0, also with half the steps, and adds `weight` times the difference to the error. */
static int hold(loop *self, const double *tau, double duration, double weight, double *gone)
{
    const int count = steps_of(self, duration);
    double again[BATCH_STATE];
    int i, status;
    copy(again, self->x, BATCH_STATE);
    status = go(self, self->x, tau, duration, count, gone);
    if (status == NOSLIP_OK && weight > 0) {
        double unused;
        if (go(self, again, tau, duration, 2 * count, &unused) == NOSLIP_OK) {
            for (i = 0; i < BATCH_STATE; i++) {
                again[i] -= self->x[i];
            }
            self->error += SAFETY * weight * largest(again);
        }
    }
    if (status == NOSLIP_SINGULAR && rate(self, self->x, tau, again) == NOSLIP_OK) {
        self->edge = KNOWN * largest(again);
    }
    return status;
}

/* -- a run ------------------------------------------------------------------------------------------------------------- */

/* Evaluates the friction use of the contacts of the true robot. */
static void note_use(loop *self, const true_state *state, const double *tau)
{
#if BATCH_CONTACTS
    const batch_sample *sample = self->sample;
    double ground[4 * BATCH_STANDING]; /* supports too */
    int k;
    if (!(sample->mu > 0) || BATCH_JUDGE(_ground)(&self->truth, &state->named, tau, ground) != NOSLIP_OK) {
        return;
    }
    for (k = 0; k < BATCH_CONTACTS; k++) {
        const double *at = ground + 4 * k, load = sample->share * NOSLIP_GRAVITY * at[3] + sample->height * at[2];
        const double size = noslip_sqrt(at[0] * at[0] + at[1] * at[1]);
        const double use = load > 0 ? size / (sample->mu * load) : infinite();
        self->outcome->use = use > self->outcome->use ? use : self->outcome->use;
    }
#else
    (void)self;
    (void)state;
    (void)tau;
#endif
}

/* Keeps the errors of the true outputs at the instants asked for, if an output time is the first not before one. */
static void keep_error(loop *self, double t, const double *error)
{
    const batch_settings *settings = self->settings;
    int i;
    while (self->instant < settings->instants && t >= settings->instant[self->instant] - 1e-9 * settings->output_step) {
        for (i = 0; i < BATCH_ROWS; i++) {
            self->errors[i * settings->instants + self->instant] = error[i];
        }
        self->instant++;
    }
}

/* Keeps the errors at an output time, and the inputs. */
static void record(loop *self, double t, const double *error, const double *tau)
{
    const batch_settings *settings = self->settings;
    batch_outcome *outcome = self->outcome;
    int i;
    for (i = 0; i < BATCH_ROWS; i++) {
        const double size = noslip_abs(error[i]);
        outcome->final[i] = error[i];
        outcome->peak[i] = size <= outcome->peak[i] ? outcome->peak[i] : size;
        outcome->settling[i] = size <= settings->band[i] ? outcome->settling[i] : t;
    }
    keep_error(self, t, error);
    if (self->row_count < self->most_rows) {
        batch_row *row = &self->rows[self->row_count];
        row->t = t;
        copy(row->x, self->x, BATCH_STATE);
        copy(row->tau, tau, BATCH_INPUTS);
        copy(row->error, error, BATCH_ROWS);
        row->status = self->status;
#if BATCH_ROUTE
        row->piece = self->piece;
#else
        row->piece = 0;
#endif
        self->row_count++;
    }
}

/* Keeps the largest absolute value of each input. */
static void push(batch_outcome *outcome, const double *tau)
{
    int i;
    for (i = 0; i < BATCH_INPUTS; i++) {
        outcome->effort[i] = noslip_abs(tau[i]) > outcome->effort[i] ? noslip_abs(tau[i]) : outcome->effort[i];
    }
}

/* Evaluates the errors of the true outputs at an output time. */
static void note(loop *self, double t, const double *given)
{
    double y[BATCH_ROWS], error[BATCH_ROWS], tau[BATCH_INPUTS] = {0};
    true_state state;
    int i, good;
    look(self, t);
    if (given != NULL) {
        torques(self, self->x, given, tau);
    }
    if (BATCH_DRIVE) { /* other drives hold theirs between output times */
        push(self->outcome, tau);
    }
    copy(state.at, self->x, BATCH_STATE);
    note_use(self, &state, tau);
    good = BATCH_JUDGE(_output)(&self->truth, &state.named, y) == NOSLIP_OK;
    for (i = 0; i < BATCH_ROWS; i++) {
        error[i] = good ? y[i] - self->reference[reference_of_row[i]] : not_a_number();
    }
    record(self, t, error, tau);
}

/* Ends a run early. */
static void stop(loop *self, double t, int status)
{
    self->status = status;
    note(self, t, NULL);
    self->outcome->t_end = t;
    self->over = 1;
}

/* Whether the error is too large and a better method or a shorter step is left to try. */
static int repeats(const loop *self)
{
    return self->error > self->settings->accuracy && self->level < REPEATED;
}

/* Adds to the time with the present status. */
static void spend(const loop *self, double seconds)
{
    batch_outcome *outcome = self->outcome;
    if (self->status == NOSLIP_SATURATED) {
        outcome->saturated += seconds;
    } else if (self->status == NOSLIP_GRIP_LIMITED) {
        outcome->grip += seconds;
    } else if (self->status == NOSLIP_WILL_SLIP) {
        outcome->will_slip += seconds;
    } else if (self->status == NOSLIP_SLIPPING) {
        outcome->slipping += seconds;
    }
}

/* Calls the controller of a run for the k-th time, at time t, for the period until `end`. */
static void control(loop *self, double t, double k, double end)
{
    int status;
    if (k > 0) {
        advance(self);
    }
    status = sense(self, t);
    if (status >= 0) {
        status = update(self);
    }
    if (status >= 0) {
        status = lead(self, t);
    }
    if (status >= 0) {
        status = command(self, t, self->given[(uint64_t)k % WAITING]);
    }
    if (!running(status)) {
        stop(self, t, status);
        return;
    }
    spend(self, least(end, self->sample->duration) - t);
}

/* What acts on a run: the command of a call, if there was one. */
static const double *acting(const loop *self, double call)
{
    return call < 0 ? self->first : self->given[(uint64_t)call % WAITING];
}

/* Integrates from t, for `duration` seconds in the period until `end`, and ends the run if that fails; see hold. */
static void hold_run(loop *self, const double *given, double t, double duration, double weight, double end)
{
    double gone;
    const int status = hold(self, given, duration, weight, &gone);
    if (status != NOSLIP_OK) {
        spend(self, -(least(end, self->sample->duration) - (t + gone)));
        stop(self, t + gone, status);
    }
}

/* -- a team ------------------------------------------------------------------------------------------------------------ */

#if BATCH_LANES
/* The group of a run, and its lane there. */
static lanes_group *group_of(team *self, int run)
{
    return &self->lanes[run / self->kit->width];
}

static int lane_of(const team *self, int run)
{
    return run % self->kit->width;
}

/* Copies the entries of a run from an array of vectors. */
static void take(const team *self, int run, const double *from, double *to, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        to[i] = from[i * self->kit->width + lane_of(self, run)];
    }
}

/* Copies the entries of a run to an array of vectors. */
static void put(const team *self, int run, const double *from, double *to, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        to[i * self->kit->width + lane_of(self, run)] = from[i];
    }
}

/* The place of a call in the ring. */
static int slot(double call)
{
    return call < 0 ? -1 : (int)((uint64_t)call % WAITING);
}

/* What changes in a run is in its lane; the scalar code borrows it, and returns it if the run goes on. */
static void borrow(team *self, int lane)
{
    const lanes_group *group = group_of(self, lane);
    loop *run = &self->run[lane];
    take(self, lane, group->x, run->x, BATCH_STATE);
    take(self, lane, group->total, &run->error, 1);
#if BATCH_STEPS
    take(self, lane, group->final, run->outcome->final, BATCH_ROWS);
    take(self, lane, group->peak, run->outcome->peak, BATCH_ROWS);
    take(self, lane, group->settling, run->outcome->settling, BATCH_ROWS);
    take(self, lane, group->effort, run->outcome->effort, BATCH_INPUTS);
    take(self, lane, group->use, &run->outcome->use, 1);
#endif
}

static void hand_back(team *self, int lane)
{
    lanes_group *group = group_of(self, lane);
    loop *run = &self->run[lane];
    put(self, lane, run->x, group->x, BATCH_STATE);
    put(self, lane, &run->error, group->total, 1);
#if BATCH_STEPS
    put(self, lane, run->outcome->final, group->final, BATCH_ROWS);
    put(self, lane, run->outcome->peak, group->peak, BATCH_ROWS);
    put(self, lane, run->outcome->settling, group->settling, BATCH_ROWS);
    put(self, lane, run->outcome->effort, group->effort, BATCH_INPUTS);
    put(self, lane, &run->outcome->use, group->use, 1);
#endif
    if (run->made) { /* the law has been initialized */
#if BATCH_STEPS /* with the limits of the inputs */
        batch_put_law(&run->law, &group->believed[lane_of(self, lane)], self->kit->width);
#if BATCH_CONTACTS
        put(self, lane, &run->law.grip.weight, group->weight, 1);
        put(self, lane, &run->law.grip.height, group->raised, 1);
#endif
#else
        batch_put_law(&run->believed, &group->believed[lane_of(self, lane)], self->kit->width);
#endif
        batch_put_law(&run->truth, &group->truth[lane_of(self, lane)], self->kit->width);
        put(self, lane, &run->sign, group->sign, 1);
        run->made = 0;
    }
    group->going[lane_of(self, lane)] = !run->over;
    self->ended = self->ended || run->over;
}

/* Hands a team to the lanes before it starts. */
static void hand_over(team *self)
{
    static const lanes_group none = {0};
    const batch_settings *settings = self->run->settings;
    int lane, i;
    for (i = 0; i < LANES_GROUPS; i++) {
        self->lanes[i] = none;
    }
    self->grounded = 0;
    for (lane = 0; lane < self->count; lane++) {
        const loop *run = &self->run[lane];
        const batch_sample *sample = run->sample;
        lanes_group *group = group_of(self, lane);
        if (run->over) {
            continue;
        }
        batch_put_plant(&run->robot, &group->plant[lane_of(self, lane)], self->kit->width);
        put(self, lane, sample->offset, group->offset, BATCH_REFERENCE);
        put(self, lane, sample->slope, group->slope, BATCH_REFERENCE);
        put(self, lane, &sample->omega, group->omega, 1);
        put(self, lane, sample->most_acceleration, group->most_acceleration, BATCH_DOF);
        put(self, lane, run->first, group->first, BATCH_GIVEN);
        put(self, lane, settings->band, group->band, BATCH_ROWS);
        put(self, lane, &sample->mu, group->mu, 1);
        put(self, lane, &sample->share, group->share, 1);
        put(self, lane, &sample->height, group->height, 1);
        self->grounded = self->grounded || sample->mu > 0;
        hand_back(self, lane);
    }
}

/* The command of a call for a lane, from the vectors. */
static const double *command_of(team *self, int lane, double call)
{
    loop *run = &self->run[lane];
    if (call >= 0) {
        take(self, lane, group_of(self, lane)->ring[slot(call)], run->given[slot(call)], BATCH_GIVEN);
    }
    return acting(run, call);
}

/* Whether a run goes on and its lane is not fine. */
static int not_fine(team *self, int lane)
{
    return !self->run[lane].over && !(group_of(self, lane)->fine[lane_of(self, lane)] > 0);
}

/* Calls the controllers for the k-th time; the first call determines the side of the singular set. */
static void control_lanes(team *self, double t, double k, double end)
{
    const int steps = BATCH_STEPS && k > 0;
    int i, unusual = 0;
    if (steps && self->kit->step(self->lanes, t, slot(k), self->run->settings->on_limit == NOSLIP_GRIP) && !self->unusual) {
        return;
    }
    for (i = 0; i < self->count; i++) {
        loop *run = &self->run[i];
        if (run->over) {
            continue;
        }
        if (steps && !not_fine(self, i)) {
            run->status = NOSLIP_OK;
        } else {
            borrow(self, i);
            control(run, t, k, end);
            put(self, i, run->given[slot(k)], group_of(self, i)->ring[slot(k)], BATCH_GIVEN);
            hand_back(self, i);
            unusual = unusual || run->status != NOSLIP_OK;
        }
    }
    self->unusual = unusual;
}

/* Integrates with the commands of a call from t, for `duration` seconds in the period until `end`; see hold. */
static void hold_lanes(team *self, double call, double t, double duration, double weight, double end)
{
    const int all = self->kit->hold(self->lanes, slot(call), duration, method_of(self->run), steps_of(self->run, duration),
                                    SAFETY * weight);
    int i;
    for (i = 0; i < self->count && !all; i++) {
        if (not_fine(self, i)) {
            borrow(self, i);
            hold_run(&self->run[i], command_of(self, i, call), t, duration, weight, end);
            hand_back(self, i);
        }
    }
}

/* Evaluates the errors at an output time. */
static void note_lanes(team *self, double t, double call)
{
    int i, every = !BATCH_STEPS || self->run->settings->instants > 0;
    if (BATCH_STEPS) {
        every = !self->kit->look(self->lanes, t, slot(call), self->grounded) || every;
    }
    for (i = 0; i < self->count && every; i++) {
        loop *run = &self->run[i];
        if (run->over) {
            continue;
        }
        if (!BATCH_STEPS || not_fine(self, i)) {
            borrow(self, i);
            note(run, t, command_of(self, i, call));
            hand_back(self, i);
        } else {
            double error[BATCH_ROWS];
            take(self, i, group_of(self, i)->final, error, BATCH_ROWS);
            keep_error(run, t, error);
        }
    }
}
#endif

/* Calls the controllers for the k-th time. */
static void control_all(team *self, double t, double k, double end)
{
#if BATCH_LANES
    if (self->kit != NULL) {
        control_lanes(self, t, k, end);
        return;
    }
#endif
    control(self->run, t, k, end);
    self->ended = self->run->over;
}

/* The inputs of a call act from t, for `duration` seconds in the period until `end`. */
static void hold_all(team *self, double call, double t, double duration, double weight, double end)
{
#if BATCH_LANES
    if (self->kit != NULL) {
        hold_lanes(self, call, t, duration, weight, end);
        return;
    }
#endif
    hold_run(self->run, acting(self->run, call), t, duration, weight, end);
    self->ended = self->run->over;
}

/* Notes the inputs that begin to act, which drives do at output times. */
static void push_all(team *self, double call)
{
#if !BATCH_DRIVE
    int i;
#if BATCH_STEPS
    if (self->kit != NULL) {
        self->kit->push(self->lanes, slot(call));
        return;
    }
#endif
    for (i = 0; i < self->count; i++) {
        if (!self->run[i].over) {
            push(self->run[i].outcome, acting(&self->run[i], call));
        }
    }
#else
    (void)self;
    (void)call;
#endif
}

/* Evaluates the errors at an output time. */
static void note_all(team *self, double t, double call)
{
#if BATCH_LANES
    if (self->kit != NULL) {
        note_lanes(self, t, call);
        return;
    }
#endif
    note(self->run, t, acting(self->run, call));
}

/* Ends the runs whose error is too large, or all. Returns whether one goes on. */
static int goes_on(team *self, int last)
{
    int i, found = 0;
    self->ended = 0;
    for (i = 0; i < self->count; i++) {
        loop *run = &self->run[i];
        if (!run->over) {
#if BATCH_LANES
            if (self->kit != NULL) {
                take(self, i, group_of(self, i)->total, &run->error, 1);
            }
#endif
            run->over = last || repeats(run);
#if BATCH_LANES
            if (self->kit != NULL && run->over) {
                borrow(self, i);
                group_of(self, i)->going[lane_of(self, i)] = 0;
            }
#endif
        }
        found = found || !run->over;
    }
    return found;
}

/* From the first call to the last output time. */
static void march(team *self)
{
    const batch_sample *sample = self->run->sample; /* of any run: the times are the same */
    const double output_step = self->run->settings->output_step, slack = 1e-9 * least(sample->period, output_step);
    const double rows = -floor_of(-(sample->duration / output_step - 1e-9)); /* except the last */
    const double late = sample->delay + sample->drive_delay, periods_late = -floor_of(-(late / sample->period - 1e-9)) - 1;
    const double whole = periods_late > 0 ? periods_late : 0, rest = late - whole * sample->period;
    double t = 0, row = 0, row_number = 0, checked = 0, k;
    int i, part;
    for (i = 0; i < self->count; i++) {
        loop *run = &self->run[i];
        const int status = run->over ? NOSLIP_OK : init_drives(run, run->first);
        if (status < 0 || (whole > WAITING - 2 && !run->over)) {
            stop(run, 0, status < 0 ? status : NOSLIP_BAD_PARAMETER);
        }
    }
#if BATCH_LANES
    if (self->kit != NULL) {
        hand_over(self);
    }
#endif
    if (rows <= 0) {
        row = sample->duration;
    }
    if (!goes_on(self, 0)) {
        return;
    }
    for (k = 0;; k++) {
        const double end = (k + 1) * sample->period;
        double weight = 0;
        control_all(self, t, k, end);
        if (self->ended && !goes_on(self, 0)) {
            return;
        }
        if (k >= checked) { /* this error represents those of the calls until the next estimate; frequent at first */
            weight = 1 + floor_of(least(k / 8, LATEST - 1));
            checked = k + weight;
        }
        for (part = 0; part < 2; part++) {
            const double call = k - whole - (part ? 0 : 1); /* whose command acts */
            const double last = part ? end : least(t + rest, end);
            while (t < last) {
                const int due = row < last - slack;
                const double until = due ? row : last;
                push_all(self, call);
                if (until > t) {
                    hold_all(self, call, t, until - t, weight, end);
                    if (self->ended && !goes_on(self, 0)) {
                        return;
                    }
                }
                t = until > t ? until : t;
                if (due) {
                    note_all(self, row, call);
                    if (row_number >= rows) {
                        for (i = 0; i < self->count; i++) {
                            self->run[i].outcome->t_end = self->run[i].over ? self->run[i].outcome->t_end : row;
                        }
                        (void)goes_on(self, 1);
                        return;
                    }
                    row_number++;
                    row = row_number < rows ? row_number * output_step : sample->duration;
                }
            }
        }
        if (weight > 0 && !goes_on(self, 0)) {
            return;
        }
    }
}

/* Starts a run as often repeated as `level` says, from a start changed by `nudge` in every component. Returns the status. */
static int start(loop *self, int level, double nudge)
{
    const batch_sample *sample = self->sample;
    union { BATCH_JUDGE_ROBOT(_params) named; double at[BATCH_PARAMETERS]; } params;
    double *numbers = (double *)self->outcome;
    int i, status = (int)sample->refused;
    for (i = 0; i < (int)(sizeof(batch_outcome) / sizeof(double)); i++) {
        numbers[i] = 0;
    }
    for (i = 0; i < BATCH_ROWS * self->settings->instants; i++) {
        self->errors[i] = not_a_number();
    }
    self->instant = 0;
    self->row_count = 0;
    self->status = NOSLIP_OK;
    self->error = 0;
    self->edge = 0;
    self->level = level;
    self->step = self->settings->longest / (1 << (level > 1 ? level - 1 : 0));
    for (i = 0; i < BATCH_STATE; i++) {
        self->x[i] = sample->start[i] + nudge;
    }
#if BATCH_EXTENSION
    copy(self->extension, sample->extension, BATCH_EXTENSION);
#endif
    show_truth(self);
    copy(params.at, sample->plant, BATCH_PARAMETERS);
    if (status >= 0) {
        status = BATCH_PLANT(_init)(&self->robot, &params.named);
    }
#if BATCH_INTEGRALS
    for (i = 0; i < BATCH_INTEGRALS && status >= 0; i++) {
        status = BATCH_RUNTIME(noslip_integral_init)(&self->integral[i], (BATCH_REAL)sample->ki[i],
                                                     (BATCH_REAL)sample->integral_limit[i]);
    }
#endif
#if BATCH_OBSERVERS
    for (i = 0; i < BATCH_OBSERVERS && status >= 0; i++) {
        status = BATCH_RUNTIME(noslip_disturbance_init)(&self->observer[i], (BATCH_REAL)sample->ko[i],
                                                        (BATCH_REAL)sample->disturbance_limit[i]);
    }
    self->observed = 0;
#endif
    if (status >= 0) {
        status = begin(self);
    }
    if (status >= 0) {
        status = init_lead(self);
    }
    return status < 0 ? status : sense_first(self);
}

/* Completes the outcomes of a run; `status` is that of its start. */
static void finish(loop *self, int status)
{
    double *numbers = (double *)self->outcome;
    int i;
    copy(self->outcome->end, self->x, BATCH_STATE);
    self->outcome->integration_error = self->error;
    self->outcome->steps = floor_of(self->sample->period / self->step + 1 - 1e-9);
    self->outcome->order = batch_methods[method_of(self)].order;
    if (status < 0) { /* not run */
        for (i = 0; i < (int)(sizeof(batch_outcome) / sizeof(double)); i++) {
            numbers[i] = not_a_number();
        }
        self->outcome->t_end = 0;
        self->status = status;
    }
#if BATCH_ROUTE
    if (status >= 0 && running(self->status) && self->arrived) {
        self->status = NOSLIP_ARRIVED;
    }
#endif
    self->outcome->status = self->status;
}

/* The runs of a team, as `start`. */
static void attempt(team *self, int level, double nudge)
{
    int i, status[TEAM];
    for (i = 0; i < self->count; i++) {
        status[i] = start(&self->run[i], level, nudge);
        self->run[i].over = status[i] < 0;
    }
    self->unusual = 1;
    self->ended = 0;
    march(self);
    for (i = 0; i < self->count; i++) {
        finish(&self->run[i], status[i]);
    }
}

/*
 * Growth of the integration error of a run in which the loop does not damp it: if the inputs are discontinuous (encoders, float), an
 * error may change a step; near the singular set the inputs grow without bound. Determined by a run from a start changed by the
 * error.
 */
static double grown(const loop *self)
{
    batch_settings settings = *self->settings;
    batch_outcome outcome;
    loop other;
    team alone;
    double apart[BATCH_STATE];
    int i;
    settings.accuracy = DBL_MAX;
    settings.instants = 0;
    other.settings = &settings;
    other.sample = self->sample;
    other.outcome = &outcome;
    other.errors = NULL;
    other.rows = NULL;
    other.most_rows = 0;
    alone.kit = NULL;
    alone.count = 1;
    alone.run = &other;
    attempt(&alone, self->level, self->error);
    for (i = 0; i < BATCH_STATE; i++) {
        apart[i] = outcome.end[i] - self->outcome->end[i];
    }
    return SAFETY * largest(apart) + self->edge;
}

/* Adds the growth of the error of a run that is not repeated. */
static void settle(loop *self)
{
    if ((BATCH_SINGLE || self->sample->counts > 0 || self->status == NOSLIP_SINGULAR) && self->error > 0) {
        self->outcome->integration_error += grown(self);
    }
}

/* -- all samples ------------------------------------------------------------------------------------------------------- */

/* Samples that wait for others to be run with them. */
typedef struct queue {
    long sample[COMING + TEAM];
    int count;
} queue;

static const lanes_kit *kit_of(const batch_settings *settings)
{
#if BATCH_LANES
#if defined(__x86_64__)
    if (settings->vectors >= 3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq")) {
        return &lanes_avx512;
    }
    if (settings->vectors >= 2 && __builtin_cpu_supports("avx2")) {
        return &lanes_avx2;
    }
#endif
    return settings->vectors >= 1 ? &lanes_plain : NULL;
#else
    (void)settings;
    return NULL;
#endif
}

const char *batch_vectors(const batch_settings *settings)
{
    const lanes_kit *kit = kit_of(settings);
    return kit != NULL ? kit->name : "scalar";
}

/* Whether the calls of two samples are at the same times. */
static int together(const batch_sample *one, const batch_sample *other)
{
    const double apart[] = {one->period - other->period, one->delay - other->delay, one->duration - other->duration,
                            one->drive_delay - other->drive_delay};
    int i, same = 1;
    for (i = 0; i < 4; i++) {
        same = same && !(noslip_abs(apart[i]) > 0);
    }
    return same;
}

/* Takes the first sample of a queue and those with the same times, `most` at most. Returns their number. */
static int choose(queue *self, const batch_sample *samples, int most, long *chosen)
{
    const long first = self->sample[0];
    int i, count = 0, left = 0;
    for (i = 0; i < self->count; i++) {
        const long each = self->sample[i];
        if (count < most && together(&samples[first], &samples[each])) {
            chosen[count++] = each;
        } else {
            self->sample[left++] = each;
        }
    }
    self->count = left;
    return count;
}

void batch_run(const batch_settings *settings, const batch_sample *samples, long count, double *outcomes, long width)
{
    const lanes_kit *kit = kit_of(settings);
    const int most = kit != NULL ? kit->width * LANES_GROUPS : 1;
    const int full = kit != NULL ? COMING : 1;
    queue queues[REPEATED + 1]; /* for each number of repetitions */
    long next = 0;
    int level, i;
    for (level = 0; level <= REPEATED; level++) {
        queues[level].count = 0;
    }
    for (;;) {
        loop runs[TEAM];
        batch_outcome outcome[TEAM];
        long chosen[TEAM];
        team self;
        while (next < count && queues[0].count < full) {
            queues[0].sample[queues[0].count++] = next++;
        }
        level = REPEATED; /* a full queue, or, if no sample is left, the first that is not empty */
        while (level > 0 && queues[level].count < full) {
            level--;
        }
        while (level < REPEATED && queues[level].count == 0) {
            level++;
        }
        if (queues[level].count == 0) {
            return;
        }
        self.count = choose(&queues[level], samples, most, chosen);
        self.kit = self.count > 1 ? kit : NULL;
        self.run = runs;
        for (i = 0; i < self.count; i++) {
            double *row = outcomes + chosen[i] * width;
            runs[i].settings = settings;
            runs[i].sample = &samples[chosen[i]];
            runs[i].outcome = &outcome[i];
            runs[i].errors = row + sizeof *outcome / sizeof(double);
            runs[i].rows = NULL;
            runs[i].most_rows = 0;
        }
        attempt(&self, level, 0);
        for (i = 0; i < self.count; i++) {
            if (repeats(&runs[i])) {
                queues[level + 1].sample[queues[level + 1].count++] = chosen[i];
            } else {
                settle(&runs[i]);
                copy(outcomes + chosen[i] * width, (const double *)&outcome[i], (int)(sizeof *outcome / sizeof(double)));
            }
        }
    }
}

long batch_trace(const batch_settings *settings, const batch_sample *sample, batch_row *rows, long most)
{
    batch_settings alone = *settings;
    batch_outcome outcome;
    loop run;
    team self;
    alone.instants = 0;
    run.settings = &alone;
    run.sample = sample;
    run.outcome = &outcome;
    run.errors = NULL;
    run.rows = rows;
    run.most_rows = most;
    self.kit = NULL;
    self.count = 1;
    self.run = &run;
    attempt(&self, 0, 0);
    while (repeats(&run)) {
        attempt(&self, run.level + 1, 0);
    }
    return run.row_count;
}
