/*
 * noslip_path.h - composite paths: lines and arcs in sequence, forward and in reverse, with a stop at the end.
 *
 * Purpose: a law of Type IV needs the position of the vehicle relative to the path. After each measurement of the pose,
 * noslip_path_update computes the current line or arc, the foot of the reference point P_l on it (the closest point) and the
 * desired speed:
 *
 *     status = noslip_path_update(&path, x, y, heading, forward_speed, &guide);
 *     ... then follow of the law with &guide.foot; guide.speed and guide.speed_rate are the desired speed and its rate
 *
 * Initialize the law once, with the L of the path (and W for a law with the suffix _offset), and again where guide.L changes,
 * on the other side of a cusp. A law without `follow` is initialized for each segment, where guide.changed, with guide.L, x, y,
 * heading and curvature.
 *
 * Points. P_l lies L ahead of the vehicle's point and W to its left; the vehicle's point lies `ahead` ahead of the middle of
 * the axle, about which the vehicle turns. The lookahead of P_l, L + ahead, is its distance ahead of the axle. Driving forward
 * requires a positive lookahead, driving in reverse a negative one: with the other sign the heading diverges from the path.
 *
 * Progress is the position of the foot of P_l on the current segment, m from its start. On an arc the foot recurs with every
 * turn; the one nearest to the last progress is taken (nearest to 0 on a new segment). Arcs of several turns are therefore
 * followed correctly as long as P_l moves by less than half a turn about the centre between two updates.
 *
 * Switching. The segments between two stops form a run. Stops are the cusps, where the vehicle starts or stops reversing, and
 * the end of a path that is not closed.
 *   1. A segment ends when progress >= its length. The next segment of the run is then followed. One update may pass several
 *      short segments in order, at most NOSLIP_MOST_ENDED and one lap, so that its cost is bounded on any path. None is skipped:
 *      after a larger jump the next updates go on. Until then the guide is at the foot on the tangent or circle of a segment
 *      that has ended.
 *   2. After the last segment of a run its tangent is followed, until P_l has moved on by the distance that `stop` requires:
 *      zero, or |lookahead|, so that the axle stops at the end of the segment. This is the stop.
 *   3. Before a stop the desired speed is sqrt(2 deceleration remaining), at most `speed` and at least `creep` (without
 *      deceleration: `speed`). Its rate is the derivative along the motion, -deceleration forward_speed / speed, with the
 *      quotient limited to 0 to 2. From the stop on the desired speed is 0, however the vehicle moves.
 *   4. At a cusp the next run begins when |forward_speed| <= creep: direction, L and segment change in one update, so that the
 *      law is initialized with the new L while the vehicle stands. P_l is then on the other side of the axle. It has already
 *      passed |lookahead forward| + |lookahead backward| (NOSLIP_STOP_POINT) or the new |lookahead| (NOSLIP_STOP_AXLE) of the
 *      run; if the run begins with an arc, P_l is off the path by about lookahead^2 / (2 radius).
 *   5. At the end the status is NOSLIP_ARRIVED from then on, and the desired speed is 0: continue to step the law until the
 *      vehicle stands.
 * A segment that has ended is not followed again (on a closed path: before the next lap), wherever the vehicle is moved to. On
 * a path that crosses itself the vehicle therefore stays on its branch.
 *
 * On an error the guide is all zeros, and the path is unchanged.
 *
 * If cosine and sine of the heading are known, as they are to noslip_odometry, a small processor saves time with
 *
 *     status = noslip_path_step(&path, x, y, odometry.direction, forward_speed);
 *
 * The result is in path.guide; on an error it is unchanged, and it is not valid before the first successful step.
 *
 * Everything exists for double and, with the suffix _f, for float. An update computes one sine and cosine and at most two square
 * roots and an arctangent, and the same again for each segment that ends in it. This does not depend on the number of segments.
 * Only at the beginning of a run, at a cusp, while the vehicle stands, there is an addition for each segment of the run.
 */
#ifndef NOSLIP_PATH_H
#define NOSLIP_PATH_H

#include "noslip_controller.h"

#ifdef __cplusplus
extern "C" {
#endif

#define NOSLIP_MOST_ENDED 64 /* number of segments that may end in one update */

/* The point that comes to rest at a cusp and at the end. */
typedef enum noslip_path_stop {
    NOSLIP_STOP_POINT = 0, /* P_l */
    NOSLIP_STOP_AXLE = 1,  /* the middle of the axle: P_l continues straight by |L + ahead| */
    NOSLIP_PATH_STOP_AS_INT = -0x7fffffff
} noslip_path_stop;

/* Why init rejects a path, and the meaning of the size of the fault. */
typedef enum noslip_path_fault_kind {
    NOSLIP_FAULT_NONE = 0,
    NOSLIP_FAULT_EMPTY,     /* there is no segment */
    NOSLIP_FAULT_OPTIONS,   /* an option is not finite, has the wrong sign or an unknown value */
    NOSLIP_FAULT_NONFINITE, /* a number is not finite, or an angle (size, rad) exceeds NOSLIP_ANGLE_MAX */
    NOSLIP_FAULT_LENGTH,    /* a length (size, m) that is not positive */
    NOSLIP_FAULT_REVERSING, /* a segment to be driven in reverse, and options.reversing is NOSLIP_REFUSE */
    NOSLIP_FAULT_LEVER,     /* the lookahead L + ahead (size, m) is zero or has the wrong sign for the direction */
    NOSLIP_FAULT_TIGHT,     /* an arc whose radius is too small by size (m, may be 0): the axle cannot follow it */
    NOSLIP_FAULT_GAP,       /* a segment begins at a distance (size, m) from the end of the previous one */
    NOSLIP_FAULT_KINK,      /* its direction of travel differs (size, rad) from the end of the previous segment */
    NOSLIP_FAULT_CUSP,      /* reversing begins or ends, but the direction does not change by pi (error: size, rad) */
    NOSLIP_FAULT_SHORT,     /* with NOSLIP_STOP_POINT: the run after a cusp is too short (by size, m): P_l passes its end
                               when it changes to the other side of the axle */
    NOSLIP_PATH_FAULT_KIND_AS_INT = -0x7fffffff
} noslip_path_fault_kind;

/* The stage within a segment. */
typedef enum noslip_path_stage {
    NOSLIP_ALONG = 0,   /* on a segment */
    NOSLIP_BEYOND = 1,  /* on the straight extension of the last segment of a run */
    NOSLIP_AT_STOP = 2, /* on this extension, with the stop reached */
    NOSLIP_PATH_STAGE_AS_INT = -0x7fffffff
} noslip_path_stage;

/* -- double: generated from noslip_path.inc by guarantees/headers.py --------------------------------------------------- */

/* A line or an arc. */
typedef struct noslip_segment {
    double x, y;           /* m: start point */
    double heading;        /* rad: direction of travel at the start */
    double curvature;      /* 1/m: positive turns left, 0 is a line */
    double length;         /* m */
    int backward;          /* 1: driven in reverse, the heading of the vehicle being opposite to the direction of travel */
} noslip_segment;

/* Options of path following. Zero selects the default, except for `speed`, which is required. */
typedef struct noslip_path_options {
    double speed;             /* m/s, positive: desired speed between stops */
    double deceleration;      /* m/s^2: before a stop; 0: the desired speed drops to 0 at the stop */
    double creep;             /* m/s: lowest desired speed before a stop; the vehicle counts as standing below it; 0: 0.01 */
    double gap;               /* m: largest gap between segments; 0: 1e-6, for float 1e-4 */
    double kink;              /* rad: largest change of direction between segments; 0: 1e-6, for float 1e-4 */
    double L[2];              /* m: distance of P_l ahead of the vehicle's point, driving forward [0] and in reverse [1] */
    double W;                 /* m: distance of P_l to the left of the vehicle's point */
    double ahead;             /* m: distance of the vehicle's point ahead of the middle of the axle */
    noslip_on_reversing reversing; /* NOSLIP_REFUSE: segments in reverse are an error; NOSLIP_SWITCH: P_l changes sides for them */
    noslip_path_stop stop;    /* NOSLIP_STOP_POINT or NOSLIP_STOP_AXLE */
    int closed;               /* 1: the last segment is followed by the first; 0: the path ends there */
} noslip_path_options;

/* The first fault of a path, in the order of its segments; runs that are too short are reported after all other faults. */
typedef struct noslip_path_fault {
    noslip_path_fault_kind kind;
    int segment;      /* index from 0; the second one if the fault is between two segments; -1: no particular segment */
    double size;      /* see noslip_path_fault_kind */
} noslip_path_fault;

/* The current segment, the position of the vehicle relative to it, and the desired speed. A segment here may also be the straight
 * extension at the end of a run. */
typedef struct noslip_guide {
    int segment;                /* index from 0; for a straight extension that of the segment it extends */
    int backward;               /* 1: driven in reverse */
    int changed;                /* 1: the segment differs from the last update, or is the first: initialize a law without `follow` */
    int waiting;                /* 1: at a cusp, until |forward_speed| <= creep */
    int arrived;                /* 1: the end is reached */
    double L;                   /* m: the L of P_l to use now */
    double x, y;                /* m: start of the segment */
    double heading;             /* rad: direction of travel at its start */
    double curvature;           /* 1/m: positive turns left, 0 is a line */
    double progress;            /* m: of P_l from the start of the segment; may be negative */
    double left;                /* m: from P_l to the end of the segment; it ends at 0 or below. A smooth function of the pose.
                                   While waiting, m/s: |forward_speed| - creep. When arrived: the largest number */
    double remaining;           /* m: from P_l to the stop, negative beyond it; the largest number if there is no stop */
    noslip_foot foot;              /* position relative to the foot of P_l on the segment, x in the direction of travel */
    double speed;               /* m/s: desired forward speed of the vehicle, negative in reverse */
    double speed_rate;          /* m/s^2: derivative of `speed` along the motion */
} noslip_guide;

/* Properties of the current segment that are not in the guide. Part of noslip_path. */
typedef struct noslip_current {
    noslip_path_stage stage;
    int is_arc;               /* 1: an arc; 0: a line, or a curvature that has no effect */
    double cosine, sine;      /* of the heading at its start */
    double radius;            /* m: of an arc, 1 / curvature */
    double length;            /* m */
    double rest;              /* m: from its end to the stop; the largest number if there is no stop */
    double rounded;           /* m: rounding error of `rest` (Kahan) */
    double cruise;            /* m/s: desired forward speed far from a stop */
    double braking_rate;      /* m/s^2: rate of the forward speed before a stop */
    double end_left;          /* m: it ends if at most this is left; at a stop the largest number: no condition */
    double end_speed;         /* m/s: a stop ends at this |forward_speed|; -1 at the end of the path; else the largest number */
} noslip_current;

/* State of a path before a step, which is restored if the step fails. `ended` is the number of segments that have ended in the
 * step, or count + 2 if no more may end. Part of noslip_path. */
typedef struct noslip_saved {
    int segment;
    noslip_path_stage stage;
    int ended, changed;
    double progress, rest, rounded;
} noslip_saved;

/* The path: initialized by init, owned by the caller, who does not write to it. */
typedef struct noslip_path {
    const noslip_segment *segments;
    int count;
    int closed;
    double speed, deceleration, creep;
    double brake;                    /* m/s^2: 2 deceleration */
    double braking_distance;      /* m: the desired speed decreases from this distance to a stop on; less a margin for rounding */
    double L[2];
    double W;
    double extension[2];             /* m: length of the extension at the end of a run, driving forward [0] and in reverse [1] */
    noslip_current current;
    noslip_saved saved;
    noslip_guide guide;              /* of the last update */
    int started;                     /* NOSLIP_READY after the first update */
    int ready;                       /* set by init */
} noslip_path;

/*
 * Initializes a path at the start of its first segment. The array `segments` is not copied: the caller must keep it unchanged.
 * Returns NOSLIP_BAD_PARAMETER (options) or NOSLIP_BAD_PATH (segments) with the reason in `fault`, which may be NULL.
 */
NOSLIP_NODISCARD int noslip_path_init(noslip_path *self, const noslip_segment *segments, int count,
        const noslip_path_options *options, noslip_path_fault *fault);

/*
 * Computes the guide for the current segment at a pose of the vehicle's point (m, rad) and a forward speed (m/s), without
 * changing the path or switching to another segment.
 * Returns NOSLIP_ARRIVED if the last update did. NOSLIP_RANGE: |heading|, or the angle travelled about the centre of an arc,
 * exceeds NOSLIP_ANGLE_MAX. NOSLIP_SINGULAR: P_l is at the centre of the arc.
 */
int noslip_path_look(const noslip_path *self, double x, double y, double heading,
        double forward_speed, noslip_guide *guide);

/*
 * Switches to the next segment if the current one has ended, and computes the guide. Call it before every step of the law.
 * Returns NOSLIP_ARRIVED if the end is reached. Errors as for noslip_path_look.
 */
int noslip_path_update(noslip_path *self, double x, double y, double heading,
        double forward_speed, noslip_guide *guide);

/* -- internal ---------------------------------------------------------------------------------------------------------- */

/* Foot of P_l on a segment. */
typedef struct noslip_projection {
    double progress, left;      /* as in the guide */
    noslip_foot foot;
    double check;      /* finite only if all fields except `left` are */
} noslip_projection;

/* Prepares the first step, or returns NOSLIP_NOT_READY. */
NOSLIP_COLD int noslip_path_begin(noslip_path *self);

/*
 * If `status` is an error, restores the path and returns it. Otherwise handles the end of the current segment and returns 1 if
 * the next one has become current, 0 if the same one has to be evaluated again. `again` is 0 at the first call of a step.
 */
NOSLIP_COLD int noslip_path_advance(noslip_path *self, int status, double forward_speed,
                int again);

/* Completes a step in which noslip_path_begin or noslip_path_advance was called. */
NOSLIP_COLD void noslip_path_finish(noslip_path *self);

/* Sets the distance and speed fields of the guide at a stop; `left` is the distance to it (m). NOSLIP_ARRIVED at the last stop. */
int noslip_path_at_stop(const noslip_path *self, double left, double forward_speed,
        noslip_guide *guide);

/* Computes the foot of P_l on the current segment; `direction` is the cosine and sine of the heading. Errors occur on arcs only:
 * NOSLIP_SINGULAR, NOSLIP_RANGE, NOSLIP_NONFINITE. */
NOSLIP_HOT int noslip_project(const noslip_path *self, double x, double y,
        const double direction[2], noslip_projection *projection)
{
    const noslip_current *current = &self->current;
    const noslip_guide *guide = &self->guide;
    const double dx = x - guide->x, dy = y - guide->y;
    const double cosine = current->cosine * direction[0] + current->sine * direction[1];
    const double sine = current->cosine * direction[1] - current->sine * direction[0];
    const double along = current->cosine * dx + current->sine * dy + (guide->L * cosine - self->W * sine);
    const double left = current->cosine * dy - current->sine * dx + (guide->L * sine + self->W * cosine);
    projection->progress = along;
    projection->foot.distance = left;
    projection->foot.cosine = cosine;
    projection->foot.sine = sine;
    projection->foot.curvature = 0;
    projection->check = left;
    if (current->is_arc) {
        /* vector from the centre to P_l in units of the radius, (across, down); (0, 1) at the start of the arc */
        const double curvature = guide->curvature, across = curvature * along, down = 1 - curvature * left;
        const double radii = noslip_sqrt(across * across + down * down);
        double angle, difference, inverse;
        if (!(radii > 16 * DBL_EPSILON)) {
            return radii <= 16 * DBL_EPSILON ? NOSLIP_SINGULAR : NOSLIP_NONFINITE;
        }
        angle = noslip_angle_of(across, down, radii);
        difference = curvature * guide->progress - angle;
        if (!(noslip_abs(difference) <= (double)6.283185307179586 / 2)) {
            angle += (double)6.283185307179586 * noslip_whole_turns(difference);
            if (!noslip_angle_ok(angle)) {
                return noslip_is_finite(radii) ? NOSLIP_RANGE : NOSLIP_NONFINITE;
            }
        }
        inverse = 1 / radii;
        projection->progress = angle * current->radius;
        projection->foot.distance = (left * (1 + down) - across * along) / (1 + radii);
        projection->foot.cosine = (cosine * down + sine * across) * inverse;
        projection->foot.sine = (sine * down - cosine * across) * inverse;
        projection->foot.curvature = curvature * inverse;
        projection->check = projection->foot.distance + projection->foot.curvature + radii;
    }
    projection->left = current->length - projection->progress;
    return NOSLIP_OK;
}

/*
 * Sets the desired forward speed and its rate `remaining` m before a stop: at most `top` and at least `creep` without sign, negative
 * if `backward`. `brake` is twice the deceleration, `braking_rate` the rate of the speed.
 */
NOSLIP_HOT void noslip_slow_down(double remaining, double brake, double creep, double top,
             int backward, double braking_rate, double forward_speed,
             double *speed, double *speed_rate)
{
    double desired = noslip_sqrt(brake * remaining), share = 0;
    const int creeps = !(desired > creep);
    if (creeps) {
        desired = creep < top ? creep : top;
    }
    desired = backward ? -desired : desired;
    if (!creeps) {
        /* with this factor the speed error decays; a rate of -deceleration would slow down a vehicle that is too slow already */
        share = forward_speed / desired;
        share = share < 0 ? 0 : share > 2 ? 2 : share;
    }
    *speed = desired;
    *speed_rate = braking_rate * share;
}

/* Returns 1 if the projection and the forward speed are finite. */
NOSLIP_HOT int noslip_projection_finite(const noslip_projection *projection, double forward_speed)
{
#if defined(__FRAMAC__) /* its intervals cannot infer the terms from the sum */
    return noslip_is_finite(projection->left) && noslip_is_finite(projection->check) &&
           noslip_sum_finite(projection->foot.distance, projection->foot.curvature, forward_speed);
#else
    return noslip_sum_finite(projection->left, projection->check, forward_speed);
#endif
}

/* Copies progress and foot to a guide. */
NOSLIP_HOT void noslip_set_foot(const noslip_projection *projection, noslip_guide *guide)
{
    guide->progress = projection->progress;
    guide->foot.distance = projection->foot.distance;
    guide->foot.cosine = projection->foot.cosine;
    guide->foot.sine = projection->foot.sine;
    guide->foot.curvature = projection->foot.curvature;
}

/* Sets the distance and speed fields of a guide, unless at a stop. */
NOSLIP_HOT void noslip_set_remaining(const noslip_path *self, double left,
              double forward_speed, noslip_guide *guide)
{
    guide->left = left;
    guide->remaining = left + self->current.rest;
    if (guide->remaining < self->braking_distance) {
        noslip_slow_down(guide->remaining, self->brake, self->creep, self->speed, guide->backward,
                                      self->current.braking_rate, forward_speed, &guide->speed, &guide->speed_rate);
    } else {
        if (!(guide->remaining < DBL_MAX)) {
            guide->remaining = DBL_MAX;
        }
        guide->speed = self->current.cruise;
        guide->speed_rate = 0;
    }
}

/*
 * Same as noslip_path_update, for a heading given by its cosine and sine, `direction`. The result is in self->guide; on
 * an error it and the path do not change. Errors as for noslip_path_update, except those of the heading.
 */
NOSLIP_HOT int noslip_path_step(noslip_path *self, double x, double y,
         const double direction[2], double forward_speed)
{
    int status, more, again = 0;
    if (self == NULL || direction == NULL) {
        return NOSLIP_NULL;
    }
    if (self->started != NOSLIP_READY) {
        status = noslip_path_begin(self);
        if (status < 0) {
            return status;
        }
        again = 1;
    }
    do {
        noslip_projection projection;
        int finite;
        more = 0;
        status = noslip_project(self, x, y, direction, &projection);
        finite = status == NOSLIP_OK && noslip_projection_finite(&projection, forward_speed);
        if (finite && projection.left > self->current.end_left) {
            noslip_set_foot(&projection, &self->guide);
            noslip_set_remaining(self, projection.left, forward_speed, &self->guide);
        } else if (finite && noslip_abs(forward_speed) > self->current.end_speed) {
            noslip_set_foot(&projection, &self->guide);
            status = noslip_path_at_stop(self, projection.left, forward_speed, &self->guide);
        } else {
            status = status == NOSLIP_OK && !finite ? NOSLIP_NONFINITE : status;
            status = noslip_path_advance(self, status, forward_speed, again);
            more = status >= 0;
            again = 1;
        }
    } while (more);
    if (status >= 0) {
        self->guide.changed = 0;
        if (again) {
            noslip_path_finish(self);
        }
    }
    return status;
}

/* -- float: generated from noslip_path.inc by guarantees/headers.py ---------------------------------------------------- */

/* A line or an arc. */
typedef struct noslip_segment_f {
    float x, y;            /* m: start point */
    float heading;         /* rad: direction of travel at the start */
    float curvature;       /* 1/m: positive turns left, 0 is a line */
    float length;          /* m */
    int backward;          /* 1: driven in reverse, the heading of the vehicle being opposite to the direction of travel */
} noslip_segment_f;

/* Options of path following. Zero selects the default, except for `speed`, which is required. */
typedef struct noslip_path_options_f {
    float speed;              /* m/s, positive: desired speed between stops */
    float deceleration;       /* m/s^2: before a stop; 0: the desired speed drops to 0 at the stop */
    float creep;              /* m/s: lowest desired speed before a stop; the vehicle counts as standing below it; 0: 0.01 */
    float gap;                /* m: largest gap between segments; 0: 1e-6, for float 1e-4 */
    float kink;               /* rad: largest change of direction between segments; 0: 1e-6, for float 1e-4 */
    float L[2];               /* m: distance of P_l ahead of the vehicle's point, driving forward [0] and in reverse [1] */
    float W;                  /* m: distance of P_l to the left of the vehicle's point */
    float ahead;              /* m: distance of the vehicle's point ahead of the middle of the axle */
    noslip_on_reversing reversing; /* NOSLIP_REFUSE: segments in reverse are an error; NOSLIP_SWITCH: P_l changes sides for them */
    noslip_path_stop stop;    /* NOSLIP_STOP_POINT or NOSLIP_STOP_AXLE */
    int closed;               /* 1: the last segment is followed by the first; 0: the path ends there */
} noslip_path_options_f;

/* The first fault of a path, in the order of its segments; runs that are too short are reported after all other faults. */
typedef struct noslip_path_fault_f {
    noslip_path_fault_kind kind;
    int segment;      /* index from 0; the second one if the fault is between two segments; -1: no particular segment */
    float size;       /* see noslip_path_fault_kind */
} noslip_path_fault_f;

/* The current segment, the position of the vehicle relative to it, and the desired speed. A segment here may also be the straight
 * extension at the end of a run. */
typedef struct noslip_guide_f {
    int segment;                /* index from 0; for a straight extension that of the segment it extends */
    int backward;               /* 1: driven in reverse */
    int changed;                /* 1: the segment differs from the last update, or is the first: initialize a law without `follow` */
    int waiting;                /* 1: at a cusp, until |forward_speed| <= creep */
    int arrived;                /* 1: the end is reached */
    float L;                    /* m: the L of P_l to use now */
    float x, y;                 /* m: start of the segment */
    float heading;              /* rad: direction of travel at its start */
    float curvature;            /* 1/m: positive turns left, 0 is a line */
    float progress;             /* m: of P_l from the start of the segment; may be negative */
    float left;                 /* m: from P_l to the end of the segment; it ends at 0 or below. A smooth function of the pose.
                                   While waiting, m/s: |forward_speed| - creep. When arrived: the largest number */
    float remaining;            /* m: from P_l to the stop, negative beyond it; the largest number if there is no stop */
    noslip_foot_f foot;            /* position relative to the foot of P_l on the segment, x in the direction of travel */
    float speed;                /* m/s: desired forward speed of the vehicle, negative in reverse */
    float speed_rate;           /* m/s^2: derivative of `speed` along the motion */
} noslip_guide_f;

/* Properties of the current segment that are not in the guide. Part of noslip_path. */
typedef struct noslip_current_f {
    noslip_path_stage stage;
    int is_arc;               /* 1: an arc; 0: a line, or a curvature that has no effect */
    float cosine, sine;       /* of the heading at its start */
    float radius;             /* m: of an arc, 1 / curvature */
    float length;             /* m */
    float rest;               /* m: from its end to the stop; the largest number if there is no stop */
    float rounded;            /* m: rounding error of `rest` (Kahan) */
    float cruise;             /* m/s: desired forward speed far from a stop */
    float braking_rate;       /* m/s^2: rate of the forward speed before a stop */
    float end_left;           /* m: it ends if at most this is left; at a stop the largest number: no condition */
    float end_speed;          /* m/s: a stop ends at this |forward_speed|; -1 at the end of the path; else the largest number */
} noslip_current_f;

/* State of a path before a step, which is restored if the step fails. `ended` is the number of segments that have ended in the
 * step, or count + 2 if no more may end. Part of noslip_path. */
typedef struct noslip_saved_f {
    int segment;
    noslip_path_stage stage;
    int ended, changed;
    float progress, rest, rounded;
} noslip_saved_f;

/* The path: initialized by init, owned by the caller, who does not write to it. */
typedef struct noslip_path_f {
    const noslip_segment_f *segments;
    int count;
    int closed;
    float speed, deceleration, creep;
    float brake;                     /* m/s^2: 2 deceleration */
    float braking_distance;       /* m: the desired speed decreases from this distance to a stop on; less a margin for rounding */
    float L[2];
    float W;
    float extension[2];              /* m: length of the extension at the end of a run, driving forward [0] and in reverse [1] */
    noslip_current_f current;
    noslip_saved_f saved;
    noslip_guide_f guide;            /* of the last update */
    int started;                     /* NOSLIP_READY after the first update */
    int ready;                       /* set by init */
} noslip_path_f;

/*
 * Initializes a path at the start of its first segment. The array `segments` is not copied: the caller must keep it unchanged.
 * Returns NOSLIP_BAD_PARAMETER (options) or NOSLIP_BAD_PATH (segments) with the reason in `fault`, which may be NULL.
 */
NOSLIP_NODISCARD int noslip_path_init_f(noslip_path_f *self, const noslip_segment_f *segments, int count,
        const noslip_path_options_f *options, noslip_path_fault_f *fault);

/*
 * Computes the guide for the current segment at a pose of the vehicle's point (m, rad) and a forward speed (m/s), without
 * changing the path or switching to another segment.
 * Returns NOSLIP_ARRIVED if the last update did. NOSLIP_RANGE: |heading|, or the angle travelled about the centre of an arc,
 * exceeds NOSLIP_ANGLE_MAX. NOSLIP_SINGULAR: P_l is at the centre of the arc.
 */
int noslip_path_look_f(const noslip_path_f *self, float x, float y, float heading,
        float forward_speed, noslip_guide_f *guide);

/*
 * Switches to the next segment if the current one has ended, and computes the guide. Call it before every step of the law.
 * Returns NOSLIP_ARRIVED if the end is reached. Errors as for noslip_path_look.
 */
int noslip_path_update_f(noslip_path_f *self, float x, float y, float heading,
        float forward_speed, noslip_guide_f *guide);

/* -- internal ---------------------------------------------------------------------------------------------------------- */

/* Foot of P_l on a segment. */
typedef struct noslip_projection_f {
    float progress, left;       /* as in the guide */
    noslip_foot_f foot;
    float check;       /* finite only if all fields except `left` are */
} noslip_projection_f;

/* Prepares the first step, or returns NOSLIP_NOT_READY. */
NOSLIP_COLD int noslip_path_begin_f(noslip_path_f *self);

/*
 * If `status` is an error, restores the path and returns it. Otherwise handles the end of the current segment and returns 1 if
 * the next one has become current, 0 if the same one has to be evaluated again. `again` is 0 at the first call of a step.
 */
NOSLIP_COLD int noslip_path_advance_f(noslip_path_f *self, int status, float forward_speed,
                   int again);

/* Completes a step in which noslip_path_begin or noslip_path_advance was called. */
NOSLIP_COLD void noslip_path_finish_f(noslip_path_f *self);

/* Sets the distance and speed fields of the guide at a stop; `left` is the distance to it (m). NOSLIP_ARRIVED at the last stop. */
int noslip_path_at_stop_f(const noslip_path_f *self, float left, float forward_speed,
        noslip_guide_f *guide);

/* Computes the foot of P_l on the current segment; `direction` is the cosine and sine of the heading. Errors occur on arcs only:
 * NOSLIP_SINGULAR, NOSLIP_RANGE, NOSLIP_NONFINITE. */
NOSLIP_HOT int noslip_project_f(const noslip_path_f *self, float x, float y,
        const float direction[2], noslip_projection_f *projection)
{
    const noslip_current_f *current = &self->current;
    const noslip_guide_f *guide = &self->guide;
    const float dx = x - guide->x, dy = y - guide->y;
    const float cosine = current->cosine * direction[0] + current->sine * direction[1];
    const float sine = current->cosine * direction[1] - current->sine * direction[0];
    const float along = current->cosine * dx + current->sine * dy + (guide->L * cosine - self->W * sine);
    const float left = current->cosine * dy - current->sine * dx + (guide->L * sine + self->W * cosine);
    projection->progress = along;
    projection->foot.distance = left;
    projection->foot.cosine = cosine;
    projection->foot.sine = sine;
    projection->foot.curvature = 0;
    projection->check = left;
    if (current->is_arc) {
        /* vector from the centre to P_l in units of the radius, (across, down); (0, 1) at the start of the arc */
        const float curvature = guide->curvature, across = curvature * along, down = 1 - curvature * left;
        const float radii = noslip_sqrt_f(across * across + down * down);
        float angle, difference, inverse;
        if (!(radii > 16 * FLT_EPSILON)) {
            return radii <= 16 * FLT_EPSILON ? NOSLIP_SINGULAR : NOSLIP_NONFINITE;
        }
        angle = noslip_angle_of_f(across, down, radii);
        difference = curvature * guide->progress - angle;
        if (!(noslip_abs_f(difference) <= (float)6.283185307179586 / 2)) {
            angle += (float)6.283185307179586 * noslip_whole_turns_f(difference);
            if (!noslip_angle_ok_f(angle)) {
                return noslip_is_finite_f(radii) ? NOSLIP_RANGE : NOSLIP_NONFINITE;
            }
        }
        inverse = 1 / radii;
        projection->progress = angle * current->radius;
        projection->foot.distance = (left * (1 + down) - across * along) / (1 + radii);
        projection->foot.cosine = (cosine * down + sine * across) * inverse;
        projection->foot.sine = (sine * down - cosine * across) * inverse;
        projection->foot.curvature = curvature * inverse;
        projection->check = projection->foot.distance + projection->foot.curvature + radii;
    }
    projection->left = current->length - projection->progress;
    return NOSLIP_OK;
}

/*
 * Sets the desired forward speed and its rate `remaining` m before a stop: at most `top` and at least `creep` without sign, negative
 * if `backward`. `brake` is twice the deceleration, `braking_rate` the rate of the speed.
 */
NOSLIP_HOT void noslip_slow_down_f(float remaining, float brake, float creep, float top,
           int backward, float braking_rate, float forward_speed,
           float *speed, float *speed_rate)
{
    float desired = noslip_sqrt_f(brake * remaining), share = 0;
    const int creeps = !(desired > creep);
    if (creeps) {
        desired = creep < top ? creep : top;
    }
    desired = backward ? -desired : desired;
    if (!creeps) {
        /* with this factor the speed error decays; a rate of -deceleration would slow down a vehicle that is too slow already */
        share = forward_speed / desired;
        share = share < 0 ? 0 : share > 2 ? 2 : share;
    }
    *speed = desired;
    *speed_rate = braking_rate * share;
}

/* Returns 1 if the projection and the forward speed are finite. */
NOSLIP_HOT int noslip_projection_finite_f(const noslip_projection_f *projection, float forward_speed)
{
#if defined(__FRAMAC__) /* its intervals cannot infer the terms from the sum */
    return noslip_is_finite_f(projection->left) && noslip_is_finite_f(projection->check) &&
           noslip_sum_finite_f(projection->foot.distance, projection->foot.curvature, forward_speed);
#else
    return noslip_sum_finite_f(projection->left, projection->check, forward_speed);
#endif
}

/* Copies progress and foot to a guide. */
NOSLIP_HOT void noslip_set_foot_f(const noslip_projection_f *projection, noslip_guide_f *guide)
{
    guide->progress = projection->progress;
    guide->foot.distance = projection->foot.distance;
    guide->foot.cosine = projection->foot.cosine;
    guide->foot.sine = projection->foot.sine;
    guide->foot.curvature = projection->foot.curvature;
}

/* Sets the distance and speed fields of a guide, unless at a stop. */
NOSLIP_HOT void noslip_set_remaining_f(const noslip_path_f *self, float left,
                 float forward_speed, noslip_guide_f *guide)
{
    guide->left = left;
    guide->remaining = left + self->current.rest;
    if (guide->remaining < self->braking_distance) {
        noslip_slow_down_f(guide->remaining, self->brake, self->creep, self->speed, guide->backward,
                                      self->current.braking_rate, forward_speed, &guide->speed, &guide->speed_rate);
    } else {
        if (!(guide->remaining < FLT_MAX)) {
            guide->remaining = FLT_MAX;
        }
        guide->speed = self->current.cruise;
        guide->speed_rate = 0;
    }
}

/*
 * Same as noslip_path_update, for a heading given by its cosine and sine, `direction`. The result is in self->guide; on
 * an error it and the path do not change. Errors as for noslip_path_update, except those of the heading.
 */
NOSLIP_HOT int noslip_path_step_f(noslip_path_f *self, float x, float y,
           const float direction[2], float forward_speed)
{
    int status, more, again = 0;
    if (self == NULL || direction == NULL) {
        return NOSLIP_NULL;
    }
    if (self->started != NOSLIP_READY) {
        status = noslip_path_begin_f(self);
        if (status < 0) {
            return status;
        }
        again = 1;
    }
    do {
        noslip_projection_f projection;
        int finite;
        more = 0;
        status = noslip_project_f(self, x, y, direction, &projection);
        finite = status == NOSLIP_OK && noslip_projection_finite_f(&projection, forward_speed);
        if (finite && projection.left > self->current.end_left) {
            noslip_set_foot_f(&projection, &self->guide);
            noslip_set_remaining_f(self, projection.left, forward_speed, &self->guide);
        } else if (finite && noslip_abs_f(forward_speed) > self->current.end_speed) {
            noslip_set_foot_f(&projection, &self->guide);
            status = noslip_path_at_stop_f(self, projection.left, forward_speed, &self->guide);
        } else {
            status = status == NOSLIP_OK && !finite ? NOSLIP_NONFINITE : status;
            status = noslip_path_advance_f(self, status, forward_speed, again);
            more = status >= 0;
            again = 1;
        }
    } while (more);
    if (status >= 0) {
        self->guide.changed = 0;
        if (again) {
            noslip_path_finish_f(self);
        }
    }
    return status;
}

/* -- end of the generated part ----------------------------------------------------------------------------------------- */

#ifdef __cplusplus
}
#endif

#endif
