/*
 * noslip_ekf.h - extended Kalman filter for the pose of a vehicle: the part that is the same for all robots.
 *
 * The filter of a robot (ROBOT_ekf.h) contains one of these as `filter`. Its tick, generated from the robot's kinematics, moves the
 * estimate by encoders and gyro; the functions below correct it by poses, positions, headings and ranges to landmarks, whenever
 * these come:
 *
 *     noslip_fix fix = {0};
 *     fix.kind = NOSLIP_FIX_POSITION;
 *     fix.x = 12.3; fix.y = 4.5; fix.sd = 0.05;
 *     fix.age = 0.12;                                  it was measured 0.12 s before the last tick
 *     noslip_ekf_correct(&ekf.filter, &fix);           NOSLIP_REJECTED: the gate did not let it pass
 *
 * The covariance is P = U D U' (Bierman, Factorization methods for discrete sequential estimation, 1977): D is positive, so that P
 * has no negative eigenvalue, in float too. The numbers of a measurement are used one after the other, all linearized at the
 * same estimate; their squared normalized innovations add up to that of the measurement (chi-square with as many degrees of
 * freedom), on which the gate decides for all of them.
 *
 * A late measurement is compared with the pose at its time: the present estimate minus what was driven since, from `past`. The
 * errors of that drive are in the estimate and do not get smaller by the measurement. Their variance is therefore added to the
 * covariance again, as a bound: to x and y that of both, with that of the heading over the way driven. What the gyro's bias and the
 * scales have to do with that drive is neglected: ages are meant to be parts of a second.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_EKF_H
#define NOSLIP_EKF_H

#include "noslip_factors.h"
#include "noslip_odometry.h"

#define NOSLIP_EKF_STATES 8   /* largest number of states: the pose and five more */
#define NOSLIP_EKF_FACTORS 36 /* entries of U and D for as many */

/* What is measured. */
typedef enum noslip_fix_kind {
    NOSLIP_FIX_POSE = 0,     /* position of the sensor, heading of the vehicle */
    NOSLIP_FIX_POSITION = 1, /* position of the sensor */
    NOSLIP_FIX_HEADING = 2,  /* heading of the vehicle */
    NOSLIP_FIX_RANGE = 3,    /* distance from the sensor to a landmark */
    NOSLIP_FIX_AS_INT = -0x7fffffff
} noslip_fix_kind;

/* -- double: generated from noslip_ekf.inc by guarantees/headers.py ---------------------------------------------------- */

/* One tick in the past, in memory of the caller: what a late measurement needs. */
typedef struct noslip_ekf_past {
    double dt;            /* s: length of the tick */
    double moved[3];      /* m, m, rad: change of the pose in this tick */
    double heading;       /* rad: heading after it, as estimated then */
    double spent[2];      /* m^2, rad^2: variance that it added to the position (sum of x and y) and to the heading */
} noslip_ekf_past;

/* Options of the filter. */
typedef struct noslip_ekf_options {
    noslip_pose start;                    /* the pose at first */
    noslip_pose start_sd;                 /* its standard deviations, 1e-6 to 1e6 (m, m, rad) */
    double gate;                          /* limit of the innovation, in units of its 99.9 % quantile (chi-square); 0: 1 */
    int tolerated;                        /* rejected measurements in a row until NOSLIP_DIVERGED; 0: any number */
    noslip_ekf_past *past;                /* memory for the last ticks, used by this filter only; NULL: no late measurements */
    int capacity;                         /* number of ticks in `past` */
} noslip_ekf_options;

/* A measurement. Only the fields of its kind are read, besides `ahead`, `left` and `age`. */
typedef struct noslip_fix {
    noslip_fix_kind kind;
    double x;               /* m: measured position of the sensor; NOSLIP_FIX_RANGE: position of the landmark */
    double y;               /* m */
    double heading;         /* rad: measured heading of the vehicle, up to whole turns */
    double range;           /* m: measured distance from the sensor to the landmark */
    double sd;              /* m, 1e-6 to 1e6: standard deviation of x and of y, or of the range */
    double heading_sd;      /* rad, 1e-6 to 1e6: of the heading */
    double ahead;           /* m: place of the sensor, ahead of the vehicle's point */
    double left;            /* m: and to its left */
    double age;             /* s: how long before the last tick it was measured; 0: now */
} noslip_fix;

/*
 * The filter: estimated states and covariance P = U D U', with U upper triangular with a diagonal of ones and D diagonal and
 * positive. Owned by the caller, who may read it but not write to it.
 */
typedef struct noslip_ekf {
    double state[NOSLIP_EKF_STATES];         /* x (m), y (m), heading (rad, not wrapped), then those of the robot */
    double rounded[3];                       /* rounding errors of the pose (Kahan) */
    double factors[NOSLIP_EKF_FACTORS];      /* by columns: those of U above its diagonal, and in place of the one that of D */
    double nis;                              /* normalized innovation squared of the last measurement */
    double gate;                             /* as in the options */
    noslip_ekf_past *past;
    int capacity;
    int recorded;  /* number of ticks in `past` */
    int newest;    /* place of the last one */
    int states;    /* number of states */
    int tolerated; /* as in the options */
    int rejected;  /* measurements rejected in a row */
    int status;    /* NOSLIP_OK, or NOSLIP_DIVERGED until a measurement is accepted or the filter is reset */
    int ready;
} noslip_ekf;

/* The rows of a measurement: z - h(x), derivatives of h by the pose, variances. */
typedef struct noslip_ekf_rows {
    double residual[3];
    double by_pose[3][3];
    double variance[3];
    int count;
} noslip_ekf_rows;

/* -- internal ---------------------------------------------------------------------------------------------------------- */

/* Returns 1 for a standard deviation whose square is well inside the range of float. */
static inline int noslip_ekf_is_deviation(double sd)
{
    return sd >= (double)1e-6 && sd <= (double)1e6;
}

/* Sets an uncorrelated state. */
static inline void noslip_ekf_set(noslip_ekf *self, int state, double value, double sd)
{
    const int column = state * (state + 1) / 2;
    int i;
    self->state[state] = value;
    for (i = 0; i < state; i++) {
        self->factors[column + i] = 0;
    }
    self->factors[column + state] = sd * sd;
}

/* Sets the pose, uncorrelated with the other states, whose estimates and covariance stay. */
static inline void noslip_ekf_set_pose(noslip_ekf *self, const noslip_pose *pose,
             const noslip_pose *sd)
{
    int i, j;
    noslip_ekf_set(self, 0, pose->x, sd->x);
    noslip_ekf_set(self, 1, pose->y, sd->y);
    noslip_ekf_set(self, 2, pose->heading, sd->heading);
    for (i = 0; i < 3; i++) {
        self->rounded[i] = 0;
        for (j = 3; j < self->states; j++) {
            self->factors[j * (j + 1) / 2 + i] = 0;
        }
    }
    self->nis = 0;
    self->recorded = 0;
    self->newest = 0;
    self->rejected = 0;
    self->status = NOSLIP_OK;
}

/* Returns NOSLIP_OK if a pose and its standard deviations are valid. */
static inline int noslip_ekf_check_start(const noslip_pose *pose, const noslip_pose *sd)
{
    if (!(noslip_ekf_is_deviation(sd->x) && noslip_ekf_is_deviation(sd->y) &&
          noslip_ekf_is_deviation(sd->heading))) {
        return NOSLIP_BAD_PARAMETER;
    }
    return noslip_check_pose(pose);
}

/*
 * Initializes the filter with the pose; the filter of the robot sets its other states and `ready`. Returns NOSLIP_BAD_PARAMETER for
 * invalid options, NOSLIP_NONFINITE or NOSLIP_RANGE for the pose.
 */
static inline int noslip_ekf_start(noslip_ekf *self, const noslip_ekf_options *options,
         int states)
{
    const int remembers = options->past != NULL;
    int i;
    if (!noslip_is_limit(options->gate) || options->tolerated < 0 || options->capacity < remembers ||
        options->capacity > 65536) {
        return NOSLIP_BAD_PARAMETER;
    }
    for (i = 0; i < NOSLIP_EKF_STATES; i++) {
        self->state[i] = 0;
    }
    for (i = 0; i < NOSLIP_EKF_FACTORS; i++) {
        self->factors[i] = 0;
    }
    self->gate = options->gate > 0 ? options->gate : 1;
    self->tolerated = options->tolerated;
    self->past = options->past;
    self->capacity = remembers ? options->capacity : 0;
    self->states = states;
    i = noslip_ekf_check_start(&options->start, &options->start_sd);
    if (i == NOSLIP_OK) {
        noslip_ekf_set_pose(self, &options->start, &options->start_sd);
    }
    return i;
}

/*
 * Takes over the results of a tick: what it adds to the pose, the other states, the factors. Returns NOSLIP_NONFINITE or NOSLIP_RANGE,
 * and changes nothing, if they are not finite or the heading is out of range.
 */
NOSLIP_HOT int noslip_ekf_advance(noslip_ekf *self, const double moved[3], const double *others,
           const double *factors, int states, double dt, const double spent[2])
{
    const int size = states * (states + 1) / 2;
    double pose[3], rounded[3], sum = 0;
    int i;
    for (i = 0; i < 3; i++) {
        pose[i] = self->state[i];
        rounded[i] = self->rounded[i];
        noslip_add(&pose[i], &rounded[i], moved[i]);
    }
    for (i = 0; i < size; i++) {
        sum += factors[i];
    }
    for (i = 3; i < states; i++) {
        sum += others[i - 3];
    }
    sum += spent[0] + spent[1];
    if (!noslip_sum_finite(pose[0], pose[1], sum) || !noslip_is_finite(pose[2])) {
        return NOSLIP_NONFINITE;
    }
    if (!noslip_angle_ok(pose[2])) {
        return NOSLIP_RANGE;
    }
    for (i = 0; i < 3; i++) {
        self->state[i] = pose[i];
        self->rounded[i] = rounded[i];
    }
    for (i = 3; i < states; i++) {
        self->state[i] = others[i - 3];
    }
    for (i = 0; i < size; i++) {
        self->factors[i] = factors[i];
    }
    if (self->capacity > 0) {
        noslip_ekf_past *tick;
        self->newest = self->newest + 1 < self->capacity ? self->newest + 1 : 0;
        self->recorded += self->recorded < self->capacity;
        tick = &self->past[self->newest];
        tick->dt = dt;
        tick->heading = pose[2];
        tick->spent[0] = spent[0];
        tick->spent[1] = spent[1];
        for (i = 0; i < 3; i++) {
            tick->moved[i] = moved[i];
        }
    }
    return self->status;
}

/*
 * Computes how the pose changed in the last `age` seconds, and the variance that this added to position and heading; what was
 * driven before a correction of the heading is turned with it. Returns NOSLIP_BAD_PARAMETER if `past` does not reach back so far.
 */
NOSLIP_APART int noslip_ekf_recall(const noslip_ekf *self, double age, double moved[3],
            double spent[2])
{
    double heading = self->state[2], left = age;
    int k, at = self->newest;
    moved[0] = moved[1] = moved[2] = 0;
    spent[0] = spent[1] = 0;
    for (k = 0; k < self->recorded && left > 0; k++) {
        const noslip_ekf_past *tick = &self->past[at];
        const double share = left < tick->dt ? left / tick->dt : 1, turned = heading - tick->heading;
        double sine, cosine;
        if (!noslip_angle_ok(turned)) {
            return NOSLIP_RANGE;
        }
        noslip_sincos(turned, &sine, &cosine);
        moved[0] += share * (cosine * tick->moved[0] - sine * tick->moved[1]);
        moved[1] += share * (sine * tick->moved[0] + cosine * tick->moved[1]);
        moved[2] += share * tick->moved[2];
        spent[0] += share * tick->spent[0];
        spent[1] += share * tick->spent[1];
        heading -= tick->moved[2];
        left -= tick->dt;
        at = at > 0 ? at - 1 : self->capacity - 1;
    }
    return left <= 64 * DBL_EPSILON * age ? NOSLIP_OK : NOSLIP_BAD_PARAMETER;
}

/* Appends a row: z - h, the derivatives of h by x, y and the heading, the variance of z. */
static inline void noslip_ekf_row(noslip_ekf_rows *rows, double residual, double by_x,
           double by_y, double by_heading, double sd)
{
    const int k = rows->count;
    rows->residual[k] = residual;
    rows->by_pose[k][0] = by_x;
    rows->by_pose[k][1] = by_y;
    rows->by_pose[k][2] = by_heading;
    rows->variance[k] = sd * sd;
    rows->count = k + 1;
}

/* Computes the rows of a measurement at the pose `at`. Returns NOSLIP_SINGULAR for a landmark at the sensor itself. */
static inline int noslip_ekf_measure(const noslip_fix *fix, const double at[3],
                   noslip_ekf_rows *rows)
{
    double sine, cosine, offset_x, offset_y, dx, dy;
    noslip_sincos(at[2], &sine, &cosine);
    offset_x = fix->ahead * cosine - fix->left * sine;
    offset_y = fix->ahead * sine + fix->left * cosine;
    dx = fix->x - (at[0] + offset_x);
    dy = fix->y - (at[1] + offset_y);
    rows->count = 0;
    if (fix->kind == NOSLIP_FIX_POSE || fix->kind == NOSLIP_FIX_POSITION) {
        noslip_ekf_row(rows, dx, 1, 0, -offset_y, fix->sd);
        noslip_ekf_row(rows, dy, 0, 1, offset_x, fix->sd);
    }
    if (fix->kind == NOSLIP_FIX_POSE || fix->kind == NOSLIP_FIX_HEADING) {
        const double turn = fix->heading - at[2], turns = noslip_whole_turns(turn);
        noslip_ekf_row(rows, (turn - turns * (double)6.283203125) + turns * (double)1.7817820413527695e-05, 0, 0, 1,
                                    fix->heading_sd);
    }
    if (fix->kind == NOSLIP_FIX_RANGE) {
        const double range = noslip_sqrt(dx * dx + dy * dy);
        if (!(range > fix->sd)) {
            return NOSLIP_SINGULAR;
        }
        dx /= range;
        dy /= range;
        noslip_ekf_row(rows, fix->range - range, -dx, -dy, dx * offset_y - dy * offset_x, fix->sd);
    }
    return NOSLIP_OK;
}

/* Adds the variance c >= 0 to a state (Agee and Turner 1972). */
static inline void noslip_ekf_spread(double *factors, int state, double c)
{
    double a[3];
    int i, j;
    for (i = 0; i < 3; i++) {
        a[i] = i == state ? 1 : 0;
    }
    for (j = state; j >= 0; j--) {
        double *column = &factors[j * (j + 1) / 2];
        const double weighted = c * a[j], larger = column[j] + weighted * a[j];
        for (i = 0; i < j; i++) {
            a[i] -= a[j] * column[i];
            column[i] += weighted / larger * a[i];
        }
        c *= column[j] / larger;
        column[j] = larger;
    }
}

/* Checks the numbers of a measurement. */
static inline int noslip_ekf_check_fix(const noslip_fix *fix)
{
    const int kind = (int)fix->kind, turns = kind == NOSLIP_FIX_POSE || kind == NOSLIP_FIX_HEADING;
    if (kind < NOSLIP_FIX_POSE || kind > NOSLIP_FIX_RANGE || (kind != NOSLIP_FIX_HEADING && !noslip_ekf_is_deviation(fix->sd)) ||
        (turns && !noslip_ekf_is_deviation(fix->heading_sd)) || !noslip_is_limit(fix->age) ||
        (kind == NOSLIP_FIX_RANGE && fix->range < 0)) {
        return NOSLIP_BAD_PARAMETER;
    }
    if (!(noslip_is_finite(fix->ahead) && noslip_is_finite(fix->left)) ||
        (kind != NOSLIP_FIX_HEADING && !(noslip_is_finite(fix->x) && noslip_is_finite(fix->y))) ||
        (kind == NOSLIP_FIX_RANGE && !noslip_is_finite(fix->range)) ||
        (turns && !noslip_is_finite(fix->heading))) {
        return NOSLIP_NONFINITE;
    }
    return !turns || noslip_angle_ok(fix->heading) ? NOSLIP_OK : NOSLIP_RANGE;
}

/* Counts a rejected measurement. */
static inline int noslip_ekf_reject(noslip_ekf *self)
{
    if (self->rejected < 2147483647) {
        self->rejected++;
    }
    if (self->tolerated > 0 && self->rejected > self->tolerated) {
        self->status = NOSLIP_DIVERGED;
    }
    return self->status < 0 ? self->status : NOSLIP_REJECTED;
}

/* -- measurements ------------------------------------------------------------------------------------------------------ */

/*
 * Corrects the estimate by a measurement. Its normalized innovation squared is stored in `nis`; if it exceeds the gate, the
 * measurement is not used and NOSLIP_REJECTED returned, or NOSLIP_DIVERGED after more than `tolerated` rejections in a row.
 * On an error nothing changes: NOSLIP_NULL; NOSLIP_NOT_READY; NOSLIP_BAD_PARAMETER (kind, standard deviation, a negative range, an
 * age that is negative or beyond `past`); NOSLIP_NONFINITE; NOSLIP_RANGE (heading); NOSLIP_SINGULAR (sensor at the landmark).
 */
static inline int noslip_ekf_correct(noslip_ekf *self, const noslip_fix *fix)
{
    noslip_ekf_rows rows;
    double factors[NOSLIP_EKF_FACTORS], change[NOSLIP_EKF_STATES], gain[NOSLIP_EKF_STATES], at[3], moved[3], spent[2];
    double nis = 0, sum = 0;
    int i, k, size, status;
    if (self == NULL || fix == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    status = noslip_ekf_check_fix(fix);
    status = status < 0 ? status : noslip_ekf_recall(self, fix->age, moved, spent);
    if (status < 0) {
        return status;
    }
    for (i = 0; i < 3; i++) {
        at[i] = self->state[i] - moved[i];
    }
    if (!noslip_angle_ok(at[2])) {
        return NOSLIP_RANGE;
    }
    status = noslip_ekf_measure(fix, at, &rows);
    if (status < 0) {
        return status;
    }
    size = self->states * (self->states + 1) / 2;
    for (i = 0; i < size; i++) {
        factors[i] = self->factors[i];
    }
    for (i = 0; i < self->states; i++) {
        change[i] = 0;
    }
    for (k = 0; k < rows.count; k++) {
        double *h = rows.by_pose[k];
        double innovation, alpha, step;
        h[2] += h[0] * moved[1] - h[1] * moved[0]; /* the place then turns about the place now */
        innovation = rows.residual[k] - (h[0] * change[0] + h[1] * change[1] + h[2] * change[2]);
        alpha = noslip_factors_update(factors, self->states, h, 3, rows.variance[k], gain);
        step = innovation / alpha;
        for (i = 0; i < self->states; i++) {
            change[i] += gain[i] * step;
        }
        nis += innovation * step;
    }
    if (fix->age > 0) {
        const double place = spent[0] + spent[1] * (moved[0] * moved[0] + moved[1] * moved[1]);
        noslip_ekf_spread(factors, 0, place);
        noslip_ekf_spread(factors, 1, place);
        noslip_ekf_spread(factors, 2, spent[1]);
    }
    for (i = 0; i < size; i++) {
        sum += factors[i];
    }
    for (i = 0; i < self->states; i++) {
        change[i] += self->state[i];
        sum += change[i];
    }
    if (!noslip_sum_finite(change[0], change[1], sum + nis)) {
        return NOSLIP_NONFINITE;
    }
    if (nis > self->gate * (rows.count == 1 ? (double)10.827566 : rows.count == 2 ? (double)13.815511 : (double)16.266236)) {
        self->nis = nis;
        return noslip_ekf_reject(self);
    }
    if (!noslip_angle_ok(change[2])) {
        return NOSLIP_RANGE;
    }
    for (i = 0; i < self->states; i++) {
        self->state[i] = change[i];
    }
    for (i = 0; i < size; i++) {
        self->factors[i] = factors[i];
    }
    for (i = 0; i < 3; i++) {
        self->rounded[i] = 0;
    }
    self->nis = nis;
    self->rejected = 0;
    self->status = NOSLIP_OK;
    return NOSLIP_OK;
}

/*
 * Restarts with a pose and its standard deviations (1e-6 to 1e6), for instance after NOSLIP_DIVERGED; the other states stay.
 * On an error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_BAD_PARAMETER, NOSLIP_NONFINITE, NOSLIP_RANGE.
 */
static inline int noslip_ekf_reset(noslip_ekf *self, const noslip_pose *pose,
         const noslip_pose *sd)
{
    int status;
    if (self == NULL || pose == NULL || sd == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    status = noslip_ekf_check_start(pose, sd);
    if (status == NOSLIP_OK) {
        noslip_ekf_set_pose(self, pose, sd);
    }
    return status;
}

/* Subtracts whole turns from the heading, which is then between -pi and pi. */
static inline int noslip_ekf_unwind(noslip_ekf *self)
{
    noslip_reckoning heading;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    heading.at[2] = self->state[2];
    heading.rounded[2] = self->rounded[2];
    noslip_add_turns(&heading, -noslip_whole_turns(self->state[2]));
    if (!noslip_angle_ok(heading.at[2])) {
        return NOSLIP_RANGE;
    }
    self->state[2] = heading.at[2];
    self->rounded[2] = heading.rounded[2];
    return NOSLIP_OK;
}

/* Writes the pose and its covariance, row major; zeros with NOSLIP_NOT_READY. */
static inline int noslip_ekf_pose(const noslip_ekf *self, noslip_pose *pose,
        double covariance[9])
{
    double sums[9];
    int i, j, k;
    const int usable = self != NULL && self->ready == NOSLIP_READY;
    if (pose == NULL || covariance == NULL) {
        return NOSLIP_NULL;
    }
    for (i = 0; i < 9; i++) {
        sums[i] = 0;
    }
    for (k = 0; usable && k < self->states; k++) {
        const double *column = &self->factors[k * (k + 1) / 2];
        for (i = 0; i <= k && i < 3; i++) {
            for (j = 0; j <= k && j < 3; j++) {
                sums[3 * i + j] += (i < k ? column[i] : 1) * column[k] * (j < k ? column[j] : 1);
            }
        }
    }
    pose->x = usable ? self->state[0] : 0;
    pose->y = usable ? self->state[1] : 0;
    pose->heading = usable ? self->state[2] : 0;
    for (i = 0; i < 9; i++) {
        covariance[i] = sums[i];
    }
    return usable ? NOSLIP_OK : self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
}

/* -- float: generated from noslip_ekf.inc by guarantees/headers.py ----------------------------------------------------- */

/* One tick in the past, in memory of the caller: what a late measurement needs. */
typedef struct noslip_ekf_past_f {
    float dt;             /* s: length of the tick */
    float moved[3];       /* m, m, rad: change of the pose in this tick */
    float heading;        /* rad: heading after it, as estimated then */
    float spent[2];       /* m^2, rad^2: variance that it added to the position (sum of x and y) and to the heading */
} noslip_ekf_past_f;

/* Options of the filter. */
typedef struct noslip_ekf_options_f {
    noslip_pose_f start;                  /* the pose at first */
    noslip_pose_f start_sd;               /* its standard deviations, 1e-6 to 1e6 (m, m, rad) */
    float gate;                           /* limit of the innovation, in units of its 99.9 % quantile (chi-square); 0: 1 */
    int tolerated;                        /* rejected measurements in a row until NOSLIP_DIVERGED; 0: any number */
    noslip_ekf_past_f *past;              /* memory for the last ticks, used by this filter only; NULL: no late measurements */
    int capacity;                         /* number of ticks in `past` */
} noslip_ekf_options_f;

/* A measurement. Only the fields of its kind are read, besides `ahead`, `left` and `age`. */
typedef struct noslip_fix_f {
    noslip_fix_kind kind;
    float x;                /* m: measured position of the sensor; NOSLIP_FIX_RANGE: position of the landmark */
    float y;                /* m */
    float heading;          /* rad: measured heading of the vehicle, up to whole turns */
    float range;            /* m: measured distance from the sensor to the landmark */
    float sd;               /* m, 1e-6 to 1e6: standard deviation of x and of y, or of the range */
    float heading_sd;       /* rad, 1e-6 to 1e6: of the heading */
    float ahead;            /* m: place of the sensor, ahead of the vehicle's point */
    float left;             /* m: and to its left */
    float age;              /* s: how long before the last tick it was measured; 0: now */
} noslip_fix_f;

/*
 * The filter: estimated states and covariance P = U D U', with U upper triangular with a diagonal of ones and D diagonal and
 * positive. Owned by the caller, who may read it but not write to it.
 */
typedef struct noslip_ekf_f {
    float state[NOSLIP_EKF_STATES];          /* x (m), y (m), heading (rad, not wrapped), then those of the robot */
    float rounded[3];                        /* rounding errors of the pose (Kahan) */
    float factors[NOSLIP_EKF_FACTORS];       /* by columns: those of U above its diagonal, and in place of the one that of D */
    float nis;                               /* normalized innovation squared of the last measurement */
    float gate;                              /* as in the options */
    noslip_ekf_past_f *past;
    int capacity;
    int recorded;  /* number of ticks in `past` */
    int newest;    /* place of the last one */
    int states;    /* number of states */
    int tolerated; /* as in the options */
    int rejected;  /* measurements rejected in a row */
    int status;    /* NOSLIP_OK, or NOSLIP_DIVERGED until a measurement is accepted or the filter is reset */
    int ready;
} noslip_ekf_f;

/* The rows of a measurement: z - h(x), derivatives of h by the pose, variances. */
typedef struct noslip_ekf_rows_f {
    float residual[3];
    float by_pose[3][3];
    float variance[3];
    int count;
} noslip_ekf_rows_f;

/* -- internal ---------------------------------------------------------------------------------------------------------- */

/* Returns 1 for a standard deviation whose square is well inside the range of float. */
static inline int noslip_ekf_is_deviation_f(float sd)
{
    return sd >= (float)1e-6 && sd <= (float)1e6;
}

/* Sets an uncorrelated state. */
static inline void noslip_ekf_set_f(noslip_ekf_f *self, int state, float value, float sd)
{
    const int column = state * (state + 1) / 2;
    int i;
    self->state[state] = value;
    for (i = 0; i < state; i++) {
        self->factors[column + i] = 0;
    }
    self->factors[column + state] = sd * sd;
}

/* Sets the pose, uncorrelated with the other states, whose estimates and covariance stay. */
static inline void noslip_ekf_set_pose_f(noslip_ekf_f *self, const noslip_pose_f *pose,
                   const noslip_pose_f *sd)
{
    int i, j;
    noslip_ekf_set_f(self, 0, pose->x, sd->x);
    noslip_ekf_set_f(self, 1, pose->y, sd->y);
    noslip_ekf_set_f(self, 2, pose->heading, sd->heading);
    for (i = 0; i < 3; i++) {
        self->rounded[i] = 0;
        for (j = 3; j < self->states; j++) {
            self->factors[j * (j + 1) / 2 + i] = 0;
        }
    }
    self->nis = 0;
    self->recorded = 0;
    self->newest = 0;
    self->rejected = 0;
    self->status = NOSLIP_OK;
}

/* Returns NOSLIP_OK if a pose and its standard deviations are valid. */
static inline int noslip_ekf_check_start_f(const noslip_pose_f *pose, const noslip_pose_f *sd)
{
    if (!(noslip_ekf_is_deviation_f(sd->x) && noslip_ekf_is_deviation_f(sd->y) &&
          noslip_ekf_is_deviation_f(sd->heading))) {
        return NOSLIP_BAD_PARAMETER;
    }
    return noslip_check_pose_f(pose);
}

/*
 * Initializes the filter with the pose; the filter of the robot sets its other states and `ready`. Returns NOSLIP_BAD_PARAMETER for
 * invalid options, NOSLIP_NONFINITE or NOSLIP_RANGE for the pose.
 */
static inline int noslip_ekf_start_f(noslip_ekf_f *self, const noslip_ekf_options_f *options,
               int states)
{
    const int remembers = options->past != NULL;
    int i;
    if (!noslip_is_limit_f(options->gate) || options->tolerated < 0 || options->capacity < remembers ||
        options->capacity > 65536) {
        return NOSLIP_BAD_PARAMETER;
    }
    for (i = 0; i < NOSLIP_EKF_STATES; i++) {
        self->state[i] = 0;
    }
    for (i = 0; i < NOSLIP_EKF_FACTORS; i++) {
        self->factors[i] = 0;
    }
    self->gate = options->gate > 0 ? options->gate : 1;
    self->tolerated = options->tolerated;
    self->past = options->past;
    self->capacity = remembers ? options->capacity : 0;
    self->states = states;
    i = noslip_ekf_check_start_f(&options->start, &options->start_sd);
    if (i == NOSLIP_OK) {
        noslip_ekf_set_pose_f(self, &options->start, &options->start_sd);
    }
    return i;
}

/*
 * Takes over the results of a tick: what it adds to the pose, the other states, the factors. Returns NOSLIP_NONFINITE or NOSLIP_RANGE,
 * and changes nothing, if they are not finite or the heading is out of range.
 */
NOSLIP_HOT int noslip_ekf_advance_f(noslip_ekf_f *self, const float moved[3], const float *others,
             const float *factors, int states, float dt, const float spent[2])
{
    const int size = states * (states + 1) / 2;
    float pose[3], rounded[3], sum = 0;
    int i;
    for (i = 0; i < 3; i++) {
        pose[i] = self->state[i];
        rounded[i] = self->rounded[i];
        noslip_add_f(&pose[i], &rounded[i], moved[i]);
    }
    for (i = 0; i < size; i++) {
        sum += factors[i];
    }
    for (i = 3; i < states; i++) {
        sum += others[i - 3];
    }
    sum += spent[0] + spent[1];
    if (!noslip_sum_finite_f(pose[0], pose[1], sum) || !noslip_is_finite_f(pose[2])) {
        return NOSLIP_NONFINITE;
    }
    if (!noslip_angle_ok_f(pose[2])) {
        return NOSLIP_RANGE;
    }
    for (i = 0; i < 3; i++) {
        self->state[i] = pose[i];
        self->rounded[i] = rounded[i];
    }
    for (i = 3; i < states; i++) {
        self->state[i] = others[i - 3];
    }
    for (i = 0; i < size; i++) {
        self->factors[i] = factors[i];
    }
    if (self->capacity > 0) {
        noslip_ekf_past_f *tick;
        self->newest = self->newest + 1 < self->capacity ? self->newest + 1 : 0;
        self->recorded += self->recorded < self->capacity;
        tick = &self->past[self->newest];
        tick->dt = dt;
        tick->heading = pose[2];
        tick->spent[0] = spent[0];
        tick->spent[1] = spent[1];
        for (i = 0; i < 3; i++) {
            tick->moved[i] = moved[i];
        }
    }
    return self->status;
}

/*
 * Computes how the pose changed in the last `age` seconds, and the variance that this added to position and heading; what was
 * driven before a correction of the heading is turned with it. Returns NOSLIP_BAD_PARAMETER if `past` does not reach back so far.
 */
NOSLIP_APART int noslip_ekf_recall_f(const noslip_ekf_f *self, float age, float moved[3],
              float spent[2])
{
    float heading = self->state[2], left = age;
    int k, at = self->newest;
    moved[0] = moved[1] = moved[2] = 0;
    spent[0] = spent[1] = 0;
    for (k = 0; k < self->recorded && left > 0; k++) {
        const noslip_ekf_past_f *tick = &self->past[at];
        const float share = left < tick->dt ? left / tick->dt : 1, turned = heading - tick->heading;
        float sine, cosine;
        if (!noslip_angle_ok_f(turned)) {
            return NOSLIP_RANGE;
        }
        noslip_sincos_f(turned, &sine, &cosine);
        moved[0] += share * (cosine * tick->moved[0] - sine * tick->moved[1]);
        moved[1] += share * (sine * tick->moved[0] + cosine * tick->moved[1]);
        moved[2] += share * tick->moved[2];
        spent[0] += share * tick->spent[0];
        spent[1] += share * tick->spent[1];
        heading -= tick->moved[2];
        left -= tick->dt;
        at = at > 0 ? at - 1 : self->capacity - 1;
    }
    return left <= 64 * FLT_EPSILON * age ? NOSLIP_OK : NOSLIP_BAD_PARAMETER;
}

/* Appends a row: z - h, the derivatives of h by x, y and the heading, the variance of z. */
static inline void noslip_ekf_row_f(noslip_ekf_rows_f *rows, float residual, float by_x,
             float by_y, float by_heading, float sd)
{
    const int k = rows->count;
    rows->residual[k] = residual;
    rows->by_pose[k][0] = by_x;
    rows->by_pose[k][1] = by_y;
    rows->by_pose[k][2] = by_heading;
    rows->variance[k] = sd * sd;
    rows->count = k + 1;
}

/* Computes the rows of a measurement at the pose `at`. Returns NOSLIP_SINGULAR for a landmark at the sensor itself. */
static inline int noslip_ekf_measure_f(const noslip_fix_f *fix, const float at[3],
                      noslip_ekf_rows_f *rows)
{
    float sine, cosine, offset_x, offset_y, dx, dy;
    noslip_sincos_f(at[2], &sine, &cosine);
    offset_x = fix->ahead * cosine - fix->left * sine;
    offset_y = fix->ahead * sine + fix->left * cosine;
    dx = fix->x - (at[0] + offset_x);
    dy = fix->y - (at[1] + offset_y);
    rows->count = 0;
    if (fix->kind == NOSLIP_FIX_POSE || fix->kind == NOSLIP_FIX_POSITION) {
        noslip_ekf_row_f(rows, dx, 1, 0, -offset_y, fix->sd);
        noslip_ekf_row_f(rows, dy, 0, 1, offset_x, fix->sd);
    }
    if (fix->kind == NOSLIP_FIX_POSE || fix->kind == NOSLIP_FIX_HEADING) {
        const float turn = fix->heading - at[2], turns = noslip_whole_turns_f(turn);
        noslip_ekf_row_f(rows, (turn - turns * (float)6.283203125) + turns * (float)1.7817820413527695e-05, 0, 0, 1,
                                    fix->heading_sd);
    }
    if (fix->kind == NOSLIP_FIX_RANGE) {
        const float range = noslip_sqrt_f(dx * dx + dy * dy);
        if (!(range > fix->sd)) {
            return NOSLIP_SINGULAR;
        }
        dx /= range;
        dy /= range;
        noslip_ekf_row_f(rows, fix->range - range, -dx, -dy, dx * offset_y - dy * offset_x, fix->sd);
    }
    return NOSLIP_OK;
}

/* Adds the variance c >= 0 to a state (Agee and Turner 1972). */
static inline void noslip_ekf_spread_f(float *factors, int state, float c)
{
    float a[3];
    int i, j;
    for (i = 0; i < 3; i++) {
        a[i] = i == state ? 1 : 0;
    }
    for (j = state; j >= 0; j--) {
        float *column = &factors[j * (j + 1) / 2];
        const float weighted = c * a[j], larger = column[j] + weighted * a[j];
        for (i = 0; i < j; i++) {
            a[i] -= a[j] * column[i];
            column[i] += weighted / larger * a[i];
        }
        c *= column[j] / larger;
        column[j] = larger;
    }
}

/* Checks the numbers of a measurement. */
static inline int noslip_ekf_check_fix_f(const noslip_fix_f *fix)
{
    const int kind = (int)fix->kind, turns = kind == NOSLIP_FIX_POSE || kind == NOSLIP_FIX_HEADING;
    if (kind < NOSLIP_FIX_POSE || kind > NOSLIP_FIX_RANGE || (kind != NOSLIP_FIX_HEADING && !noslip_ekf_is_deviation_f(fix->sd)) ||
        (turns && !noslip_ekf_is_deviation_f(fix->heading_sd)) || !noslip_is_limit_f(fix->age) ||
        (kind == NOSLIP_FIX_RANGE && fix->range < 0)) {
        return NOSLIP_BAD_PARAMETER;
    }
    if (!(noslip_is_finite_f(fix->ahead) && noslip_is_finite_f(fix->left)) ||
        (kind != NOSLIP_FIX_HEADING && !(noslip_is_finite_f(fix->x) && noslip_is_finite_f(fix->y))) ||
        (kind == NOSLIP_FIX_RANGE && !noslip_is_finite_f(fix->range)) ||
        (turns && !noslip_is_finite_f(fix->heading))) {
        return NOSLIP_NONFINITE;
    }
    return !turns || noslip_angle_ok_f(fix->heading) ? NOSLIP_OK : NOSLIP_RANGE;
}

/* Counts a rejected measurement. */
static inline int noslip_ekf_reject_f(noslip_ekf_f *self)
{
    if (self->rejected < 2147483647) {
        self->rejected++;
    }
    if (self->tolerated > 0 && self->rejected > self->tolerated) {
        self->status = NOSLIP_DIVERGED;
    }
    return self->status < 0 ? self->status : NOSLIP_REJECTED;
}

/* -- measurements ------------------------------------------------------------------------------------------------------ */

/*
 * Corrects the estimate by a measurement. Its normalized innovation squared is stored in `nis`; if it exceeds the gate, the
 * measurement is not used and NOSLIP_REJECTED returned, or NOSLIP_DIVERGED after more than `tolerated` rejections in a row.
 * On an error nothing changes: NOSLIP_NULL; NOSLIP_NOT_READY; NOSLIP_BAD_PARAMETER (kind, standard deviation, a negative range, an
 * age that is negative or beyond `past`); NOSLIP_NONFINITE; NOSLIP_RANGE (heading); NOSLIP_SINGULAR (sensor at the landmark).
 */
static inline int noslip_ekf_correct_f(noslip_ekf_f *self, const noslip_fix_f *fix)
{
    noslip_ekf_rows_f rows;
    float factors[NOSLIP_EKF_FACTORS], change[NOSLIP_EKF_STATES], gain[NOSLIP_EKF_STATES], at[3], moved[3], spent[2];
    float nis = 0, sum = 0;
    int i, k, size, status;
    if (self == NULL || fix == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    status = noslip_ekf_check_fix_f(fix);
    status = status < 0 ? status : noslip_ekf_recall_f(self, fix->age, moved, spent);
    if (status < 0) {
        return status;
    }
    for (i = 0; i < 3; i++) {
        at[i] = self->state[i] - moved[i];
    }
    if (!noslip_angle_ok_f(at[2])) {
        return NOSLIP_RANGE;
    }
    status = noslip_ekf_measure_f(fix, at, &rows);
    if (status < 0) {
        return status;
    }
    size = self->states * (self->states + 1) / 2;
    for (i = 0; i < size; i++) {
        factors[i] = self->factors[i];
    }
    for (i = 0; i < self->states; i++) {
        change[i] = 0;
    }
    for (k = 0; k < rows.count; k++) {
        float *h = rows.by_pose[k];
        float innovation, alpha, step;
        h[2] += h[0] * moved[1] - h[1] * moved[0]; /* the place then turns about the place now */
        innovation = rows.residual[k] - (h[0] * change[0] + h[1] * change[1] + h[2] * change[2]);
        alpha = noslip_factors_update_f(factors, self->states, h, 3, rows.variance[k], gain);
        step = innovation / alpha;
        for (i = 0; i < self->states; i++) {
            change[i] += gain[i] * step;
        }
        nis += innovation * step;
    }
    if (fix->age > 0) {
        const float place = spent[0] + spent[1] * (moved[0] * moved[0] + moved[1] * moved[1]);
        noslip_ekf_spread_f(factors, 0, place);
        noslip_ekf_spread_f(factors, 1, place);
        noslip_ekf_spread_f(factors, 2, spent[1]);
    }
    for (i = 0; i < size; i++) {
        sum += factors[i];
    }
    for (i = 0; i < self->states; i++) {
        change[i] += self->state[i];
        sum += change[i];
    }
    if (!noslip_sum_finite_f(change[0], change[1], sum + nis)) {
        return NOSLIP_NONFINITE;
    }
    if (nis > self->gate * (rows.count == 1 ? (float)10.827566 : rows.count == 2 ? (float)13.815511 : (float)16.266236)) {
        self->nis = nis;
        return noslip_ekf_reject_f(self);
    }
    if (!noslip_angle_ok_f(change[2])) {
        return NOSLIP_RANGE;
    }
    for (i = 0; i < self->states; i++) {
        self->state[i] = change[i];
    }
    for (i = 0; i < size; i++) {
        self->factors[i] = factors[i];
    }
    for (i = 0; i < 3; i++) {
        self->rounded[i] = 0;
    }
    self->nis = nis;
    self->rejected = 0;
    self->status = NOSLIP_OK;
    return NOSLIP_OK;
}

/*
 * Restarts with a pose and its standard deviations (1e-6 to 1e6), for instance after NOSLIP_DIVERGED; the other states stay.
 * On an error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_BAD_PARAMETER, NOSLIP_NONFINITE, NOSLIP_RANGE.
 */
static inline int noslip_ekf_reset_f(noslip_ekf_f *self, const noslip_pose_f *pose,
               const noslip_pose_f *sd)
{
    int status;
    if (self == NULL || pose == NULL || sd == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    status = noslip_ekf_check_start_f(pose, sd);
    if (status == NOSLIP_OK) {
        noslip_ekf_set_pose_f(self, pose, sd);
    }
    return status;
}

/* Subtracts whole turns from the heading, which is then between -pi and pi. */
static inline int noslip_ekf_unwind_f(noslip_ekf_f *self)
{
    noslip_reckoning_f heading;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    heading.at[2] = self->state[2];
    heading.rounded[2] = self->rounded[2];
    noslip_add_turns_f(&heading, -noslip_whole_turns_f(self->state[2]));
    if (!noslip_angle_ok_f(heading.at[2])) {
        return NOSLIP_RANGE;
    }
    self->state[2] = heading.at[2];
    self->rounded[2] = heading.rounded[2];
    return NOSLIP_OK;
}

/* Writes the pose and its covariance, row major; zeros with NOSLIP_NOT_READY. */
static inline int noslip_ekf_pose_f(const noslip_ekf_f *self, noslip_pose_f *pose,
              float covariance[9])
{
    float sums[9];
    int i, j, k;
    const int usable = self != NULL && self->ready == NOSLIP_READY;
    if (pose == NULL || covariance == NULL) {
        return NOSLIP_NULL;
    }
    for (i = 0; i < 9; i++) {
        sums[i] = 0;
    }
    for (k = 0; usable && k < self->states; k++) {
        const float *column = &self->factors[k * (k + 1) / 2];
        for (i = 0; i <= k && i < 3; i++) {
            for (j = 0; j <= k && j < 3; j++) {
                sums[3 * i + j] += (i < k ? column[i] : 1) * column[k] * (j < k ? column[j] : 1);
            }
        }
    }
    pose->x = usable ? self->state[0] : 0;
    pose->y = usable ? self->state[1] : 0;
    pose->heading = usable ? self->state[2] : 0;
    for (i = 0; i < 9; i++) {
        covariance[i] = sums[i];
    }
    return usable ? NOSLIP_OK : self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
