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

#define NOSLIP_MODULE "noslip_path.inc"
#include "noslip_scalars.inc"

#ifdef __cplusplus
}
#endif

#endif
