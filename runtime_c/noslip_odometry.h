/*
 * noslip_odometry.h - dead reckoning of the pose from wheel rotation; pose corrections; wheel encoders.
 *
 * For any planar vehicle that rolls without slipping and whose forward speed and yaw rate are fixed combinations of two wheel
 * rates.
 *
 *     noslip_odometry_options options = {0};
 *     noslip_odometry_differential(&options, r, b, d);   two wheels on one axle; the pose is that of a point d ahead of it
 *     noslip_odometry_init(&self, &options, &start);
 *     noslip_odometry_move(&self, angle, dt, &pose);     at each sample
 *     noslip_odometry_unwind(&self);                     before a move, for instance where |pose.heading| > 4 rad
 *
 * The heading is not wrapped. A vehicle that drives many turns must subtract whole turns with unwind. Otherwise a move beyond
 * NOSLIP_ANGLE_MAX (8192 rad in float) is rejected with NOSLIP_RANGE, and before that the resolution of the heading decreases.
 *
 * self.pose is the last pose returned; self.direction contains cosine and sine of its heading, for noslip_path_step.
 *
 * The result is exact if both wheels turn at constant rates between two samples: the middle of the axle then moves along an arc
 * whose chord is the distance times sin(turn / 2) / (turn / 2), in the direction of the mean heading. Sums are compensated (Kahan),
 * so that float does not lose small steps. The rounding of each step remains: a direction is accurate to 1e-7 in float, plus
 * heading * 6e-8.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_ODOMETRY_H
#define NOSLIP_ODOMETRY_H

#include "noslip_controller.h"

/* How a correction is applied. */
typedef enum noslip_correction {
    NOSLIP_RESET = 0,    /* at once: the pose jumps */
    NOSLIP_BUMPLESS = 1, /* gradually, over the time `release` */
    NOSLIP_CORRECTION_AS_INT = -0x7fffffff
} noslip_correction;

/* -- double: generated from noslip_odometry.inc by guarantees/headers.py ----------------------------------------------- */

/* Position of a point of the vehicle, and heading, counterclockwise from the x axis and not wrapped. */
typedef struct noslip_pose {
    double x;            /* m */
    double y;            /* m */
    double heading;      /* rad */
} noslip_pose;

/* Kinematics of the vehicle. All fields except those of the wheels may be zero. */
typedef struct noslip_odometry_options {
    double forward[2];      /* m/rad: forward distance per angle of each wheel */
    double turn[2];         /* rad/rad: change of heading per angle of each wheel */
    double ahead;           /* m: distance of the vehicle's point ahead of the axle */
    double release;         /* s: time over which a bumpless correction is applied; 0: at once */
} noslip_odometry_options;

/* Dead reckoning: estimated pose of the axle. */
typedef struct noslip_reckoning {
    double at[3];           /* m, m, rad: x and y of the middle of the axle, heading */
    double rounded[3];      /* rounding errors of these (Kahan) */
} noslip_reckoning;

/* Dead reckoning of one vehicle. The returned pose is the estimated one plus the part of a bumpless correction that has not been
 * applied yet. */
typedef struct noslip_odometry {
    noslip_odometry_options options;
    noslip_reckoning now;
    noslip_pose pose;              /* last pose returned */
    double direction[2];           /* cosine and sine of its heading */
    double pending[3];             /* m, m, rad: previous minus corrected pose at the last correction */
    double left;                   /* s: remaining time until the correction is applied completely */
    int steady;                    /* NOSLIP_READY: no correction is pending */
    int ready;
} noslip_odometry;

/* Converts the counter of an encoder, which wraps around, to angles of its wheel. */
typedef struct noslip_encoder {
    double angle;      /* rad per count */
    double scale;      /* rad per count / full, without its lower half of bits: its product with up to 4095 counts is exact */
    double rest;       /* of it: the lower half of bits */
    double carry;      /* rad: what rounding has left out of the angles written, so that errors do not add up */
    uint32_t mask;     /* the bits of the counter */
    uint32_t full;     /* 2^(32 - bits): shifts the highest bit of the counter to bit 31 */
    uint32_t last;     /* last counter value read */
    int started;       /* NOSLIP_READY: the counter has been read */
    int ready;
} noslip_encoder;

/* -- internal ---------------------------------------------------------------------------------------------------------- */

/*
 * Adds whole turns to the heading. 2 pi is used in two parts; the first has so few bits that its product with `turns` is exact. If
 * turns are subtracted, the difference is exact too.
 */
static inline void noslip_add_turns(noslip_reckoning *reckoning, double turns)
{
    reckoning->at[2] += turns * (double)6.283203125;
    noslip_add(&reckoning->at[2], &reckoning->rounded[2], turns * (double)-1.7817820413527695e-05);
}

/* Returns NOSLIP_NONFINITE or NOSLIP_RANGE for an invalid pose. */
static inline int noslip_check_pose(const noslip_pose *pose)
{
    if (!noslip_sum_finite(pose->x, pose->y, pose->heading)) {
        return NOSLIP_NONFINITE;
    }
    return noslip_angle_ok(pose->heading) ? NOSLIP_OK : NOSLIP_RANGE;
}

/* Computes the pose of the axle for a pose of the vehicle's point, with `turns` whole turns added to the heading; `direction` is
 * the cosine and sine of the heading. */
static inline void noslip_axle_from(const noslip_odometry *self,
                         const noslip_pose *pose, const double direction[2],
                         double turns, noslip_reckoning *axle)
{
    int i;
    axle->at[0] = pose->x - self->options.ahead * direction[0];
    axle->at[1] = pose->y - self->options.ahead * direction[1];
    axle->at[2] = pose->heading;
    for (i = 0; i < 3; i++) {
        axle->rounded[i] = 0;
    }
    noslip_add_turns(axle, turns);
}

/* Computes the displacement of the axle along an arc of more than 1/4 rad; see noslip_move_axle. */
NOSLIP_APART void noslip_long_arc(const noslip_reckoning *from, double distance,
                             double turn, double moved[2])
{
    const double chord = distance * noslip_sinc(turn / 2);
    noslip_sincos(from->at[2] + (turn / 2 - from->rounded[2]), &moved[1], &moved[0]);
    moved[0] *= chord;
    moved[1] *= chord;
}

/*
 * Moves the axle along an arc of length `distance` that turns by `turn`; `before` and `after` are cosine and sine of the heading.
 * The chord of the arc has the direction of the mean heading. For a short arc this is the direction of the sum of `before` and
 * `after`, whose length is 2 cos(turn / 2). Returns NOSLIP_RANGE if the heading is outside the range of noslip_sincos, or NaN.
 */
NOSLIP_HOT int noslip_move_axle(const noslip_reckoning *from, const double before[2],
                     double distance, double turn, noslip_reckoning *to,
                     double after[2])
{
    double x, y;
    to->at[2] = from->at[2];
    to->rounded[2] = from->rounded[2];
    noslip_add(&to->at[2], &to->rounded[2], turn);
    if (!noslip_angle_ok(to->at[2])) {
        return NOSLIP_RANGE;
    }
    noslip_sincos(to->at[2], &after[1], &after[0]);
    if (noslip_abs(turn) <= (double)0.25) {
        const double share = distance * noslip_half_tanc(turn);
        x = share * (before[0] + after[0]);
        y = share * (before[1] + after[1]);
    } else {
        double moved[2];
        noslip_long_arc(from, distance, turn, moved);
        x = moved[0];
        y = moved[1];
    }
    to->at[0] = from->at[0];
    to->at[1] = from->at[1];
    to->rounded[0] = from->rounded[0];
    to->rounded[1] = from->rounded[1];
    noslip_add(&to->at[0], &to->rounded[0], x);
    noslip_add(&to->at[1], &to->rounded[1], y);
    return NOSLIP_OK;
}

/* Computes the pose of the vehicle's point from that of the axle, without pending corrections. */
NOSLIP_HOT void noslip_pose_of(const noslip_odometry *self,
                                const noslip_reckoning *reckoning,
                                const double direction[2], noslip_pose *pose)
{
    pose->x = reckoning->at[0] + self->options.ahead * direction[0];
    pose->y = reckoning->at[1] + self->options.ahead * direction[1];
    pose->heading = reckoning->at[2];
}

/* Stores the pose of the axle and that of the vehicle's point. */
NOSLIP_HOT void noslip_store_pose(noslip_odometry *self,
                               const noslip_reckoning *next,
                               const noslip_pose *pose, const double direction[2])
{
    self->now.at[0] = next->at[0];
    self->now.at[1] = next->at[1];
    self->now.at[2] = next->at[2];
    self->now.rounded[0] = next->rounded[0];
    self->now.rounded[1] = next->rounded[1];
    self->now.rounded[2] = next->rounded[2];
    self->pose.x = pose->x;
    self->pose.y = pose->y;
    self->pose.heading = pose->heading;
    self->direction[0] = direction[0];
    self->direction[1] = direction[1];
}

/* Stores a new pose of the axle, with `left` s until the correction `pending` is applied. On an error nothing changes. */
NOSLIP_APART int noslip_odometry_store(noslip_odometry *self,
                                      const noslip_reckoning *next,
                                      const double direction[2], const double pending[3],
                                      double left)
{
    noslip_pose pose;
    int i, status;
    if (!noslip_angle_ok(next->at[2])) {
        return NOSLIP_RANGE;
    }
    noslip_pose_of(self, next, direction, &pose);
    if (left > 0) {
        const double share = left / self->options.release;
        pose.x += pending[0] * share;
        pose.y += pending[1] * share;
        pose.heading += pending[2] * share;
    }
    status = noslip_check_pose(&pose);
    if (status != NOSLIP_OK) {
        return status;
    }
    noslip_store_pose(self, next, &pose, direction);
    if (left > 0) {
        noslip_sincos(pose.heading, &self->direction[1], &self->direction[0]);
    }
    for (i = 0; i < 3; i++) {
        self->pending[i] = pending[i];
    }
    self->left = left;
    self->steady = left > 0 ? 0 : NOSLIP_READY;
    return status;
}

/* -- dead reckoning ---------------------------------------------------------------------------------------------------- */

/*
 * Sets the options of a vehicle with two driven wheels on one axle, the right one first: wheel radius r, half the distance b
 * between the wheels, distance d of the vehicle's point ahead of the axle (all m). The forward speed is r (w_r + w_l) / 2, the yaw
 * rate r (w_r - w_l) / (2 b). `release` is set to 0: corrections are applied at once.
 * Returns NOSLIP_BAD_PARAMETER and sets all options to 0 unless r and b are positive and all are finite.
 */
static inline int noslip_odometry_differential(noslip_odometry_options *options, double r,
                             double b, double d)
{
    int usable;
    if (options == NULL) {
        return NOSLIP_NULL;
    }
    usable = noslip_is_finite(r) && r > 0 && noslip_is_finite(b) && b > 0 &&
             noslip_is_finite(d);
    options->forward[0] = usable ? r / 2 : 0;
    options->forward[1] = options->forward[0];
    options->turn[0] = usable ? r / b / 2 : 0;
    options->turn[1] = -options->turn[0];
    options->ahead = usable ? d : 0;
    options->release = 0;
    return usable ? NOSLIP_OK : NOSLIP_BAD_PARAMETER;
}

/*
 * Initializes the pose; a null `start` means zeros. Returns NOSLIP_BAD_PARAMETER unless all options are finite, forward distance
 * and turn determine the angles of both wheels, and `release` is not negative; NOSLIP_NONFINITE or NOSLIP_RANGE for the pose.
 */
NOSLIP_NODISCARD static inline int noslip_odometry_init(noslip_odometry *self,
                          const noslip_odometry_options *options,
                          const noslip_pose *start)
{
    double direction[2], pending[3];
    noslip_reckoning reckoning;
    noslip_pose initial;
    const double *forward, *turn;
    double determinant;
    int status, i;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    self->steady = 0;
    if (options == NULL) {
        return NOSLIP_NULL;
    }
    forward = options->forward;
    turn = options->turn;
    determinant = forward[0] * turn[1] - forward[1] * turn[0];
    if (!(noslip_is_finite(determinant) && noslip_abs(determinant) > 0 &&
          noslip_is_finite(options->ahead) && noslip_is_finite(options->release) &&
          options->release >= 0)) {
        return NOSLIP_BAD_PARAMETER;
    }
    initial.x = start == NULL ? 0 : start->x;
    initial.y = start == NULL ? 0 : start->y;
    initial.heading = start == NULL ? 0 : start->heading;
    status = noslip_check_pose(&initial);
    if (status == NOSLIP_OK) {
        for (i = 0; i < 2; i++) {
            self->options.forward[i] = forward[i];
            self->options.turn[i] = turn[i];
        }
        self->options.ahead = options->ahead;
        self->options.release = options->release;
        pending[0] = pending[1] = pending[2] = 0;
        noslip_sincos(initial.heading, &direction[1], &direction[0]);
        noslip_axle_from(self, &initial, direction, 0, &reckoning);
        status = noslip_odometry_store(self, &reckoning, direction, pending, 0);
    }
    self->ready = status == NOSLIP_OK ? NOSLIP_READY : 0;
    return status;
}

/* Writes the last pose; zeros with NOSLIP_NOT_READY. */
static inline int noslip_odometry_pose(const noslip_odometry *self, noslip_pose *pose)
{
    if (pose == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->ready != NOSLIP_READY) {
        pose->x = 0;
        pose->y = 0;
        pose->heading = 0;
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    *pose = self->pose;
    return NOSLIP_OK;
}

/* Stores cosine and sine of a heading in `direction`. */
NOSLIP_APART void noslip_odometry_set_direction(noslip_odometry *self, double heading)
{
    noslip_sincos(heading, &self->direction[1], &self->direction[0]);
}

/* Returns the reason for which a move is rejected, and writes the last pose. */
NOSLIP_APART int noslip_odometry_reject(noslip_odometry *self, const double angle[2],
                      double dt, noslip_pose *pose)
{
    double distance, turn, heading, rounded;
    const int status = noslip_odometry_pose(self, pose);
    if (status != NOSLIP_OK) {
        return status;
    }
    if (self->steady != NOSLIP_READY) {
        noslip_odometry_set_direction(self, self->pose.heading);
    }
    if (angle == NULL) {
        return NOSLIP_NULL;
    }
    distance = self->options.forward[0] * angle[0] + self->options.forward[1] * angle[1];
    turn = self->options.turn[0] * angle[0] + self->options.turn[1] * angle[1];
    if (!noslip_sum_finite(distance, turn, dt)) {
        return NOSLIP_NONFINITE;
    }
    if (dt < 0) {
        return NOSLIP_BAD_PARAMETER;
    }
    heading = self->now.at[2];
    rounded = self->now.rounded[2];
    noslip_add(&heading, &rounded, turn);
    return noslip_angle_ok(heading) ? NOSLIP_NONFINITE : NOSLIP_RANGE;
}

/* Stores a new pose of the axle while a correction is being applied. */
NOSLIP_APART int noslip_odometry_blend(noslip_odometry *self,
                           const noslip_reckoning *next,
                           const double direction[2], double dt,
                           noslip_pose *pose)
{
    const double left = self->left > dt ? self->left - dt : 0;
    const int status = noslip_odometry_store(self, next, direction, self->pending, left);
    if (status != NOSLIP_OK) {
        noslip_odometry_set_direction(self, self->pose.heading);
    }
    *pose = self->pose;
    return status;
}

/*
 * Updates the pose after the wheels turned by `angle` (rad) at constant rates during dt (s, not negative), and writes it to `pose`.
 * On an error nothing changes, and `pose` is the previous one: NOSLIP_NULL, NOSLIP_NONFINITE, NOSLIP_BAD_PARAMETER (negative dt),
 * NOSLIP_RANGE if the heading leaves the range of noslip_sincos: then call noslip_odometry_unwind and repeat the same move.
 */
NOSLIP_HOT int noslip_odometry_move(noslip_odometry *self, const double angle[2],
                  double dt, noslip_pose *pose)
{
    const int steady = self != NULL && self->steady == NOSLIP_READY;
    if (angle != NULL && pose != NULL && (steady || (self != NULL && self->ready == NOSLIP_READY)) && dt >= 0 &&
        noslip_is_finite(dt)) {
        const double distance = self->options.forward[0] * angle[0] + self->options.forward[1] * angle[1];
        const double turn = self->options.turn[0] * angle[0] + self->options.turn[1] * angle[1];
        noslip_reckoning next;
        double direction[2];
        if (!steady) { /* `direction` includes the pending correction */
            noslip_odometry_set_direction(self, self->now.at[2]);
        }
        if (noslip_move_axle(&self->now, self->direction, distance, turn, &next, direction) == NOSLIP_OK) {
            noslip_pose reached;
            noslip_pose_of(self, &next, direction, &reached);
            if (noslip_sum_finite(reached.x, reached.y, reached.heading)) {
                if (!steady) { /* pass copies, so that the originals stay in registers */
                    const noslip_reckoning to = {{next.at[0], next.at[1], next.at[2]},
                                                              {next.rounded[0], next.rounded[1], next.rounded[2]}};
                    const double towards[2] = {direction[0], direction[1]};
                    return noslip_odometry_blend(self, &to, towards, dt, pose);
                }
                noslip_store_pose(self, &next, &reached, direction);
                pose->x = reached.x;
                pose->y = reached.y;
                pose->heading = reached.heading;
                return NOSLIP_OK;
            }
        }
    }
    return noslip_odometry_reject(self, angle, dt, pose);
}

/* Same as noslip_odometry_move, for wheels that turned at a `rate` (rad/s) during dt (s). */
static inline int noslip_odometry_rates(noslip_odometry *self, const double rate[2],
                      double dt, noslip_pose *pose)
{
    double angle[2];
    angle[0] = rate == NULL ? 0 : rate[0] * dt;
    angle[1] = rate == NULL ? 0 : rate[1] * dt;
    return noslip_odometry_move(self, rate == NULL ? NULL : angle, dt, pose);
}

/*
 * Corrects the pose to a measured one, `truth`. NOSLIP_RESET: the pose is `truth` from now on, with the heading as given.
 * NOSLIP_BUMPLESS: dead reckoning continues from `truth`, but the returned pose does not jump: the difference to the previous pose,
 * of the heading within half a turn, decreases linearly to zero during the next moves, over the time `release`. A correction
 * replaces one that is still being applied.
 * On an error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_BAD_PARAMETER (mode), NOSLIP_NONFINITE, NOSLIP_RANGE.
 */
static inline int noslip_odometry_correct(noslip_odometry *self,
                             const noslip_pose *truth, int mode)
{
    noslip_reckoning next;
    noslip_pose after;
    double direction[2], pending[3], turns = 0, left = 0;
    int status;
    if (self == NULL || truth == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (mode != NOSLIP_RESET && mode != NOSLIP_BUMPLESS) {
        return NOSLIP_BAD_PARAMETER;
    }
    status = noslip_check_pose(truth);
    if (status != NOSLIP_OK) {
        return status;
    }
    if (mode == NOSLIP_BUMPLESS) {
        turns = noslip_whole_turns(self->pose.heading - truth->heading);
    }
    pending[0] = pending[1] = pending[2] = 0;
    noslip_sincos(truth->heading, &direction[1], &direction[0]);
    noslip_axle_from(self, truth, direction, turns, &next);
    noslip_pose_of(self, &next, direction, &after);
    status = noslip_check_pose(&after);
    if (status != NOSLIP_OK) {
        return status;
    }
    if (mode == NOSLIP_BUMPLESS) {
        pending[0] = self->pose.x - after.x;
        pending[1] = self->pose.y - after.y;
        pending[2] = self->pose.heading - after.heading;
        left = self->options.release;
    }
    return noslip_odometry_store(self, &next, direction, pending, left);
}

/* Subtracts whole turns from the heading, which is then between -pi and pi except for a pending correction. The position does not
 * change. */
static inline int noslip_odometry_unwind(noslip_odometry *self)
{
    noslip_reckoning next;
    double direction[2];
    int i;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    for (i = 0; i < 3; i++) {
        next.at[i] = self->now.at[i];
        next.rounded[i] = self->now.rounded[i];
    }
    noslip_sincos(next.at[2], &direction[1], &direction[0]);              /* before unwinding, so that no bit of the position changes */
    noslip_add_turns(&next, -noslip_whole_turns(next.at[2]));
    return noslip_odometry_store(self, &next, direction, self->pending, self->left);
}

/* -- encoders ---------------------------------------------------------------------------------------------------------- */

/*
 * Initializes an encoder with `counts_per_turn` of its wheel (negative if it counts down when the wheel rolls forward, for example
 * because it is mounted the other way round) and a counter of 2 to 32 bits. Returns NOSLIP_BAD_PARAMETER for other values.
 */
NOSLIP_NODISCARD static inline int noslip_encoder_init(noslip_encoder *self, double counts_per_turn,
                    int counter_bits)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    self->started = 0;
    if (!(noslip_is_finite(counts_per_turn) && (counts_per_turn >= 1 || counts_per_turn <= -1)) ||
        counter_bits < 2 || counter_bits > 32) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->angle = (double)6.283185307179586 / counts_per_turn;
    self->mask = UINT32_MAX >> (32 - counter_bits);
    self->full = UINT32_C(1) << (32 - counter_bits);
    self->scale = noslip_upper_half(self->angle / (double)self->full);
    self->rest = self->angle / (double)self->full - self->scale;
    self->carry = 0;
    self->last = 0;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* Handles the first reading of a counter, and errors. */
NOSLIP_APART int noslip_encoder_start(noslip_encoder *self, uint32_t counter,
                                      double *angle)
{
    if (angle == NULL) {
        return NOSLIP_NULL;
    }
    *angle = 0;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    self->carry = 0;
    self->last = counter;
    self->started = NOSLIP_READY;
    return NOSLIP_OK;
}

/*
 * Writes the angle (rad) by which the wheel turned since the last reading; 0 at the first one. Between two readings the counter
 * must change by less than half its range; a larger change is taken as a rotation in the other direction. Bits above those of the
 * counter are ignored.
 */
static inline int noslip_encoder_read(noslip_encoder *self, uint32_t counter, double *angle)
{
    uint32_t change; /* of the counter, shifted so that its highest bit is bit 31 */
    double counts, most, turned;
    if (self == NULL || angle == NULL || self->started != NOSLIP_READY) {
        return noslip_encoder_start(self, counter, angle);
    }
    change = (counter - self->last) * self->full;
    counts = (double)(int32_t)change;
    most = counts * self->scale;
    turned = most + (counts * self->rest + self->carry);
    self->carry = counts * self->rest + self->carry - (turned - most);
    self->last = counter;
    *angle = turned;
    return NOSLIP_OK;
}

/* -- float: generated from noslip_odometry.inc by guarantees/headers.py ------------------------------------------------ */

/* Position of a point of the vehicle, and heading, counterclockwise from the x axis and not wrapped. */
typedef struct noslip_pose_f {
    float x;             /* m */
    float y;             /* m */
    float heading;       /* rad */
} noslip_pose_f;

/* Kinematics of the vehicle. All fields except those of the wheels may be zero. */
typedef struct noslip_odometry_options_f {
    float forward[2];       /* m/rad: forward distance per angle of each wheel */
    float turn[2];          /* rad/rad: change of heading per angle of each wheel */
    float ahead;            /* m: distance of the vehicle's point ahead of the axle */
    float release;          /* s: time over which a bumpless correction is applied; 0: at once */
} noslip_odometry_options_f;

/* Dead reckoning: estimated pose of the axle. */
typedef struct noslip_reckoning_f {
    float at[3];            /* m, m, rad: x and y of the middle of the axle, heading */
    float rounded[3];       /* rounding errors of these (Kahan) */
} noslip_reckoning_f;

/* Dead reckoning of one vehicle. The returned pose is the estimated one plus the part of a bumpless correction that has not been
 * applied yet. */
typedef struct noslip_odometry_f {
    noslip_odometry_options_f options;
    noslip_reckoning_f now;
    noslip_pose_f pose;            /* last pose returned */
    float direction[2];            /* cosine and sine of its heading */
    float pending[3];              /* m, m, rad: previous minus corrected pose at the last correction */
    float left;                    /* s: remaining time until the correction is applied completely */
    int steady;                    /* NOSLIP_READY: no correction is pending */
    int ready;
} noslip_odometry_f;

/* Converts the counter of an encoder, which wraps around, to angles of its wheel. */
typedef struct noslip_encoder_f {
    float angle;       /* rad per count */
    float scale;       /* rad per count / full, without its lower half of bits: its product with up to 4095 counts is exact */
    float rest;        /* of it: the lower half of bits */
    float carry;       /* rad: what rounding has left out of the angles written, so that errors do not add up */
    uint32_t mask;     /* the bits of the counter */
    uint32_t full;     /* 2^(32 - bits): shifts the highest bit of the counter to bit 31 */
    uint32_t last;     /* last counter value read */
    int started;       /* NOSLIP_READY: the counter has been read */
    int ready;
} noslip_encoder_f;

/* -- internal ---------------------------------------------------------------------------------------------------------- */

/*
 * Adds whole turns to the heading. 2 pi is used in two parts; the first has so few bits that its product with `turns` is exact. If
 * turns are subtracted, the difference is exact too.
 */
static inline void noslip_add_turns_f(noslip_reckoning_f *reckoning, float turns)
{
    reckoning->at[2] += turns * (float)6.283203125;
    noslip_add_f(&reckoning->at[2], &reckoning->rounded[2], turns * (float)-1.7817820413527695e-05);
}

/* Returns NOSLIP_NONFINITE or NOSLIP_RANGE for an invalid pose. */
static inline int noslip_check_pose_f(const noslip_pose_f *pose)
{
    if (!noslip_sum_finite_f(pose->x, pose->y, pose->heading)) {
        return NOSLIP_NONFINITE;
    }
    return noslip_angle_ok_f(pose->heading) ? NOSLIP_OK : NOSLIP_RANGE;
}

/* Computes the pose of the axle for a pose of the vehicle's point, with `turns` whole turns added to the heading; `direction` is
 * the cosine and sine of the heading. */
static inline void noslip_axle_from_f(const noslip_odometry_f *self,
                             const noslip_pose_f *pose, const float direction[2],
                             float turns, noslip_reckoning_f *axle)
{
    int i;
    axle->at[0] = pose->x - self->options.ahead * direction[0];
    axle->at[1] = pose->y - self->options.ahead * direction[1];
    axle->at[2] = pose->heading;
    for (i = 0; i < 3; i++) {
        axle->rounded[i] = 0;
    }
    noslip_add_turns_f(axle, turns);
}

/* Computes the displacement of the axle along an arc of more than 1/4 rad; see noslip_move_axle. */
NOSLIP_APART void noslip_long_arc_f(const noslip_reckoning_f *from, float distance,
                                float turn, float moved[2])
{
    const float chord = distance * noslip_sinc_f(turn / 2);
    noslip_sincos_f(from->at[2] + (turn / 2 - from->rounded[2]), &moved[1], &moved[0]);
    moved[0] *= chord;
    moved[1] *= chord;
}

/*
 * Moves the axle along an arc of length `distance` that turns by `turn`; `before` and `after` are cosine and sine of the heading.
 * The chord of the arc has the direction of the mean heading. For a short arc this is the direction of the sum of `before` and
 * `after`, whose length is 2 cos(turn / 2). Returns NOSLIP_RANGE if the heading is outside the range of noslip_sincos, or NaN.
 */
NOSLIP_HOT int noslip_move_axle_f(const noslip_reckoning_f *from, const float before[2],
                        float distance, float turn, noslip_reckoning_f *to,
                        float after[2])
{
    float x, y;
    to->at[2] = from->at[2];
    to->rounded[2] = from->rounded[2];
    noslip_add_f(&to->at[2], &to->rounded[2], turn);
    if (!noslip_angle_ok_f(to->at[2])) {
        return NOSLIP_RANGE;
    }
    noslip_sincos_f(to->at[2], &after[1], &after[0]);
    if (noslip_abs_f(turn) <= (float)0.25) {
        const float share = distance * noslip_half_tanc_f(turn);
        x = share * (before[0] + after[0]);
        y = share * (before[1] + after[1]);
    } else {
        float moved[2];
        noslip_long_arc_f(from, distance, turn, moved);
        x = moved[0];
        y = moved[1];
    }
    to->at[0] = from->at[0];
    to->at[1] = from->at[1];
    to->rounded[0] = from->rounded[0];
    to->rounded[1] = from->rounded[1];
    noslip_add_f(&to->at[0], &to->rounded[0], x);
    noslip_add_f(&to->at[1], &to->rounded[1], y);
    return NOSLIP_OK;
}

/* Computes the pose of the vehicle's point from that of the axle, without pending corrections. */
NOSLIP_HOT void noslip_pose_of_f(const noslip_odometry_f *self,
                                    const noslip_reckoning_f *reckoning,
                                    const float direction[2], noslip_pose_f *pose)
{
    pose->x = reckoning->at[0] + self->options.ahead * direction[0];
    pose->y = reckoning->at[1] + self->options.ahead * direction[1];
    pose->heading = reckoning->at[2];
}

/* Stores the pose of the axle and that of the vehicle's point. */
NOSLIP_HOT void noslip_store_pose_f(noslip_odometry_f *self,
                                   const noslip_reckoning_f *next,
                                   const noslip_pose_f *pose, const float direction[2])
{
    self->now.at[0] = next->at[0];
    self->now.at[1] = next->at[1];
    self->now.at[2] = next->at[2];
    self->now.rounded[0] = next->rounded[0];
    self->now.rounded[1] = next->rounded[1];
    self->now.rounded[2] = next->rounded[2];
    self->pose.x = pose->x;
    self->pose.y = pose->y;
    self->pose.heading = pose->heading;
    self->direction[0] = direction[0];
    self->direction[1] = direction[1];
}

/* Stores a new pose of the axle, with `left` s until the correction `pending` is applied. On an error nothing changes. */
NOSLIP_APART int noslip_odometry_store_f(noslip_odometry_f *self,
                                          const noslip_reckoning_f *next,
                                          const float direction[2], const float pending[3],
                                          float left)
{
    noslip_pose_f pose;
    int i, status;
    if (!noslip_angle_ok_f(next->at[2])) {
        return NOSLIP_RANGE;
    }
    noslip_pose_of_f(self, next, direction, &pose);
    if (left > 0) {
        const float share = left / self->options.release;
        pose.x += pending[0] * share;
        pose.y += pending[1] * share;
        pose.heading += pending[2] * share;
    }
    status = noslip_check_pose_f(&pose);
    if (status != NOSLIP_OK) {
        return status;
    }
    noslip_store_pose_f(self, next, &pose, direction);
    if (left > 0) {
        noslip_sincos_f(pose.heading, &self->direction[1], &self->direction[0]);
    }
    for (i = 0; i < 3; i++) {
        self->pending[i] = pending[i];
    }
    self->left = left;
    self->steady = left > 0 ? 0 : NOSLIP_READY;
    return status;
}

/* -- dead reckoning ---------------------------------------------------------------------------------------------------- */

/*
 * Sets the options of a vehicle with two driven wheels on one axle, the right one first: wheel radius r, half the distance b
 * between the wheels, distance d of the vehicle's point ahead of the axle (all m). The forward speed is r (w_r + w_l) / 2, the yaw
 * rate r (w_r - w_l) / (2 b). `release` is set to 0: corrections are applied at once.
 * Returns NOSLIP_BAD_PARAMETER and sets all options to 0 unless r and b are positive and all are finite.
 */
static inline int noslip_odometry_differential_f(noslip_odometry_options_f *options, float r,
                                float b, float d)
{
    int usable;
    if (options == NULL) {
        return NOSLIP_NULL;
    }
    usable = noslip_is_finite_f(r) && r > 0 && noslip_is_finite_f(b) && b > 0 &&
             noslip_is_finite_f(d);
    options->forward[0] = usable ? r / 2 : 0;
    options->forward[1] = options->forward[0];
    options->turn[0] = usable ? r / b / 2 : 0;
    options->turn[1] = -options->turn[0];
    options->ahead = usable ? d : 0;
    options->release = 0;
    return usable ? NOSLIP_OK : NOSLIP_BAD_PARAMETER;
}

/*
 * Initializes the pose; a null `start` means zeros. Returns NOSLIP_BAD_PARAMETER unless all options are finite, forward distance
 * and turn determine the angles of both wheels, and `release` is not negative; NOSLIP_NONFINITE or NOSLIP_RANGE for the pose.
 */
NOSLIP_NODISCARD static inline int noslip_odometry_init_f(noslip_odometry_f *self,
                              const noslip_odometry_options_f *options,
                              const noslip_pose_f *start)
{
    float direction[2], pending[3];
    noslip_reckoning_f reckoning;
    noslip_pose_f initial;
    const float *forward, *turn;
    float determinant;
    int status, i;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    self->steady = 0;
    if (options == NULL) {
        return NOSLIP_NULL;
    }
    forward = options->forward;
    turn = options->turn;
    determinant = forward[0] * turn[1] - forward[1] * turn[0];
    if (!(noslip_is_finite_f(determinant) && noslip_abs_f(determinant) > 0 &&
          noslip_is_finite_f(options->ahead) && noslip_is_finite_f(options->release) &&
          options->release >= 0)) {
        return NOSLIP_BAD_PARAMETER;
    }
    initial.x = start == NULL ? 0 : start->x;
    initial.y = start == NULL ? 0 : start->y;
    initial.heading = start == NULL ? 0 : start->heading;
    status = noslip_check_pose_f(&initial);
    if (status == NOSLIP_OK) {
        for (i = 0; i < 2; i++) {
            self->options.forward[i] = forward[i];
            self->options.turn[i] = turn[i];
        }
        self->options.ahead = options->ahead;
        self->options.release = options->release;
        pending[0] = pending[1] = pending[2] = 0;
        noslip_sincos_f(initial.heading, &direction[1], &direction[0]);
        noslip_axle_from_f(self, &initial, direction, 0, &reckoning);
        status = noslip_odometry_store_f(self, &reckoning, direction, pending, 0);
    }
    self->ready = status == NOSLIP_OK ? NOSLIP_READY : 0;
    return status;
}

/* Writes the last pose; zeros with NOSLIP_NOT_READY. */
static inline int noslip_odometry_pose_f(const noslip_odometry_f *self, noslip_pose_f *pose)
{
    if (pose == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->ready != NOSLIP_READY) {
        pose->x = 0;
        pose->y = 0;
        pose->heading = 0;
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    *pose = self->pose;
    return NOSLIP_OK;
}

/* Stores cosine and sine of a heading in `direction`. */
NOSLIP_APART void noslip_odometry_set_direction_f(noslip_odometry_f *self, float heading)
{
    noslip_sincos_f(heading, &self->direction[1], &self->direction[0]);
}

/* Returns the reason for which a move is rejected, and writes the last pose. */
NOSLIP_APART int noslip_odometry_reject_f(noslip_odometry_f *self, const float angle[2],
                         float dt, noslip_pose_f *pose)
{
    float distance, turn, heading, rounded;
    const int status = noslip_odometry_pose_f(self, pose);
    if (status != NOSLIP_OK) {
        return status;
    }
    if (self->steady != NOSLIP_READY) {
        noslip_odometry_set_direction_f(self, self->pose.heading);
    }
    if (angle == NULL) {
        return NOSLIP_NULL;
    }
    distance = self->options.forward[0] * angle[0] + self->options.forward[1] * angle[1];
    turn = self->options.turn[0] * angle[0] + self->options.turn[1] * angle[1];
    if (!noslip_sum_finite_f(distance, turn, dt)) {
        return NOSLIP_NONFINITE;
    }
    if (dt < 0) {
        return NOSLIP_BAD_PARAMETER;
    }
    heading = self->now.at[2];
    rounded = self->now.rounded[2];
    noslip_add_f(&heading, &rounded, turn);
    return noslip_angle_ok_f(heading) ? NOSLIP_NONFINITE : NOSLIP_RANGE;
}

/* Stores a new pose of the axle while a correction is being applied. */
NOSLIP_APART int noslip_odometry_blend_f(noslip_odometry_f *self,
                               const noslip_reckoning_f *next,
                               const float direction[2], float dt,
                               noslip_pose_f *pose)
{
    const float left = self->left > dt ? self->left - dt : 0;
    const int status = noslip_odometry_store_f(self, next, direction, self->pending, left);
    if (status != NOSLIP_OK) {
        noslip_odometry_set_direction_f(self, self->pose.heading);
    }
    *pose = self->pose;
    return status;
}

/*
 * Updates the pose after the wheels turned by `angle` (rad) at constant rates during dt (s, not negative), and writes it to `pose`.
 * On an error nothing changes, and `pose` is the previous one: NOSLIP_NULL, NOSLIP_NONFINITE, NOSLIP_BAD_PARAMETER (negative dt),
 * NOSLIP_RANGE if the heading leaves the range of noslip_sincos: then call noslip_odometry_unwind and repeat the same move.
 */
NOSLIP_HOT int noslip_odometry_move_f(noslip_odometry_f *self, const float angle[2],
                     float dt, noslip_pose_f *pose)
{
    const int steady = self != NULL && self->steady == NOSLIP_READY;
    if (angle != NULL && pose != NULL && (steady || (self != NULL && self->ready == NOSLIP_READY)) && dt >= 0 &&
        noslip_is_finite_f(dt)) {
        const float distance = self->options.forward[0] * angle[0] + self->options.forward[1] * angle[1];
        const float turn = self->options.turn[0] * angle[0] + self->options.turn[1] * angle[1];
        noslip_reckoning_f next;
        float direction[2];
        if (!steady) { /* `direction` includes the pending correction */
            noslip_odometry_set_direction_f(self, self->now.at[2]);
        }
        if (noslip_move_axle_f(&self->now, self->direction, distance, turn, &next, direction) == NOSLIP_OK) {
            noslip_pose_f reached;
            noslip_pose_of_f(self, &next, direction, &reached);
            if (noslip_sum_finite_f(reached.x, reached.y, reached.heading)) {
                if (!steady) { /* pass copies, so that the originals stay in registers */
                    const noslip_reckoning_f to = {{next.at[0], next.at[1], next.at[2]},
                                                              {next.rounded[0], next.rounded[1], next.rounded[2]}};
                    const float towards[2] = {direction[0], direction[1]};
                    return noslip_odometry_blend_f(self, &to, towards, dt, pose);
                }
                noslip_store_pose_f(self, &next, &reached, direction);
                pose->x = reached.x;
                pose->y = reached.y;
                pose->heading = reached.heading;
                return NOSLIP_OK;
            }
        }
    }
    return noslip_odometry_reject_f(self, angle, dt, pose);
}

/* Same as noslip_odometry_move, for wheels that turned at a `rate` (rad/s) during dt (s). */
static inline int noslip_odometry_rates_f(noslip_odometry_f *self, const float rate[2],
                         float dt, noslip_pose_f *pose)
{
    float angle[2];
    angle[0] = rate == NULL ? 0 : rate[0] * dt;
    angle[1] = rate == NULL ? 0 : rate[1] * dt;
    return noslip_odometry_move_f(self, rate == NULL ? NULL : angle, dt, pose);
}

/*
 * Corrects the pose to a measured one, `truth`. NOSLIP_RESET: the pose is `truth` from now on, with the heading as given.
 * NOSLIP_BUMPLESS: dead reckoning continues from `truth`, but the returned pose does not jump: the difference to the previous pose,
 * of the heading within half a turn, decreases linearly to zero during the next moves, over the time `release`. A correction
 * replaces one that is still being applied.
 * On an error nothing changes: NOSLIP_NULL, NOSLIP_NOT_READY, NOSLIP_BAD_PARAMETER (mode), NOSLIP_NONFINITE, NOSLIP_RANGE.
 */
static inline int noslip_odometry_correct_f(noslip_odometry_f *self,
                                 const noslip_pose_f *truth, int mode)
{
    noslip_reckoning_f next;
    noslip_pose_f after;
    float direction[2], pending[3], turns = 0, left = 0;
    int status;
    if (self == NULL || truth == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (mode != NOSLIP_RESET && mode != NOSLIP_BUMPLESS) {
        return NOSLIP_BAD_PARAMETER;
    }
    status = noslip_check_pose_f(truth);
    if (status != NOSLIP_OK) {
        return status;
    }
    if (mode == NOSLIP_BUMPLESS) {
        turns = noslip_whole_turns_f(self->pose.heading - truth->heading);
    }
    pending[0] = pending[1] = pending[2] = 0;
    noslip_sincos_f(truth->heading, &direction[1], &direction[0]);
    noslip_axle_from_f(self, truth, direction, turns, &next);
    noslip_pose_of_f(self, &next, direction, &after);
    status = noslip_check_pose_f(&after);
    if (status != NOSLIP_OK) {
        return status;
    }
    if (mode == NOSLIP_BUMPLESS) {
        pending[0] = self->pose.x - after.x;
        pending[1] = self->pose.y - after.y;
        pending[2] = self->pose.heading - after.heading;
        left = self->options.release;
    }
    return noslip_odometry_store_f(self, &next, direction, pending, left);
}

/* Subtracts whole turns from the heading, which is then between -pi and pi except for a pending correction. The position does not
 * change. */
static inline int noslip_odometry_unwind_f(noslip_odometry_f *self)
{
    noslip_reckoning_f next;
    float direction[2];
    int i;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    for (i = 0; i < 3; i++) {
        next.at[i] = self->now.at[i];
        next.rounded[i] = self->now.rounded[i];
    }
    noslip_sincos_f(next.at[2], &direction[1], &direction[0]);            /* before unwinding, so that no bit of the position changes */
    noslip_add_turns_f(&next, -noslip_whole_turns_f(next.at[2]));
    return noslip_odometry_store_f(self, &next, direction, self->pending, self->left);
}

/* -- encoders ---------------------------------------------------------------------------------------------------------- */

/*
 * Initializes an encoder with `counts_per_turn` of its wheel (negative if it counts down when the wheel rolls forward, for example
 * because it is mounted the other way round) and a counter of 2 to 32 bits. Returns NOSLIP_BAD_PARAMETER for other values.
 */
NOSLIP_NODISCARD static inline int noslip_encoder_init_f(noslip_encoder_f *self, float counts_per_turn,
                       int counter_bits)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    self->started = 0;
    if (!(noslip_is_finite_f(counts_per_turn) && (counts_per_turn >= 1 || counts_per_turn <= -1)) ||
        counter_bits < 2 || counter_bits > 32) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->angle = (float)6.283185307179586 / counts_per_turn;
    self->mask = UINT32_MAX >> (32 - counter_bits);
    self->full = UINT32_C(1) << (32 - counter_bits);
    self->scale = noslip_upper_half_f(self->angle / (float)self->full);
    self->rest = self->angle / (float)self->full - self->scale;
    self->carry = 0;
    self->last = 0;
    self->ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* Handles the first reading of a counter, and errors. */
NOSLIP_APART int noslip_encoder_start_f(noslip_encoder_f *self, uint32_t counter,
                                          float *angle)
{
    if (angle == NULL) {
        return NOSLIP_NULL;
    }
    *angle = 0;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    self->carry = 0;
    self->last = counter;
    self->started = NOSLIP_READY;
    return NOSLIP_OK;
}

/*
 * Writes the angle (rad) by which the wheel turned since the last reading; 0 at the first one. Between two readings the counter
 * must change by less than half its range; a larger change is taken as a rotation in the other direction. Bits above those of the
 * counter are ignored.
 */
static inline int noslip_encoder_read_f(noslip_encoder_f *self, uint32_t counter, float *angle)
{
    uint32_t change; /* of the counter, shifted so that its highest bit is bit 31 */
    float counts, most, turned;
    if (self == NULL || angle == NULL || self->started != NOSLIP_READY) {
        return noslip_encoder_start_f(self, counter, angle);
    }
    change = (counter - self->last) * self->full;
    counts = (float)(int32_t)change;
    most = counts * self->scale;
    turned = most + (counts * self->rest + self->carry);
    self->carry = counts * self->rest + self->carry - (turned - most);
    self->last = counter;
    *angle = turned;
    return NOSLIP_OK;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#endif
