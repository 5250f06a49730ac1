/*
 * noslip_path.h - composite paths: lines and arcs, one after the other, forward and in reverse, to a stop at the end.
 *
 * What it is for: a law of Type IV follows a path whose foot it is told. noslip_path_update says after each look at the
 * vehicle which line or arc it is now, where the reference point P_l is seen from there, and how fast to drive:
 *
 *     status = noslip_path_update(&path, x, y, heading, forward_speed, &guide);
 *     ... follow of the law with &guide.foot, and with guide.speed and guide.speed_rate as wanted speed and its rate
 *
 * The law is made once, with the path's L, and W if there is one (a law whose name ends in _offset); and anew where guide.L
 * is another, as it is on the other side of a cusp. A law that has no `follow` is made for each piece, where guide.changed:
 * init with guide.L, x, y, heading, curvature.
 *
 * Points. P_l lies L ahead of the vehicle's point and W to its left; the vehicle's point lies `ahead` ahead of the middle of
 * the axle, about which the vehicle turns. The lever of P_l is L + ahead, seen from the axle. Going forward wants a positive
 * lever, going in reverse a negative one: with the other sign the heading runs away from the path.
 *
 * Progress is the foot of P_l on the piece that is followed, m from its start. On a line that is plain; on an arc the foot
 * comes again with every turn, and the one nearest to the last progress counts (nearest to 0 on a piece just begun). So arcs
 * of several turns are right as long as P_l moves less than half a turn about the centre between two updates.
 *
 * The hand-over. Segments between two stops make a run: stops are the cusps, where the vehicle begins to reverse or ceases
 * to, and the end of a path that is not closed.
 *   1. A segment ends when progress >= its length. The next one of the run is followed, P_l being where it is. One update
 *      may pass several short segments, each in its turn, at most once round. None is skipped.
 *   2. Behind the last segment of a run its tangent is followed, a straight extension, until P_l has run on by as much as
 *      `stop` asks for: not at all, or by |lever|, so that the axle stands where the segment ends. This is the stop.
 *   3. Towards a stop the wanted speed is sqrt(2 deceleration remaining), at most `speed`, at least `creep`. (No
 *      deceleration: `speed`.) Its rate is that along the motion: -deceleration forward_speed / speed, the quotient kept
 *      between 0 and 2. From the stop on it is 0, and stays so however the vehicle moves.
 *   4. At a cusp the next run begins when |forward_speed| <= creep: direction, L and segment change in one update, so that
 *      the law with the new L is made while the vehicle stands. P_l is then on the other side of the axle: where
 *      |lever forward| + |lever backward| (NOSLIP_STOP_POINT) or the new |lever| (NOSLIP_STOP_AXLE) of the run lie behind it
 *      already, and where the run begins with an arc, P_l beside it by some lever^2 / (2 radius).
 *   5. At the end the answer is NOSLIP_ARRIVED, for good. The wanted speed is 0: go on stepping the law until it stands.
 * It never goes back: a segment that was left is not followed again (in a closed path: before the next lap), wherever the
 * vehicle is moved to, so that a path which crosses itself stays on its branch.
 *
 * On an error the guide is all zeros, and the path is as it was before the call.
 *
 * Who knows cosine and sine of the heading anyway, as noslip_odometry does, and runs on a small processor, makes instead
 *
 *     status = noslip_path_step(&path, x, y, odometry.direction, forward_speed);
 *
 * and reads path.guide, which on an error stays as it was, and says nothing before the first good step.
 *
 * Everything exists for double and, with the suffix _f, for float. An update costs a sine and cosine, at most two square roots
 * and an arctangent, and for each segment that ends in it as much again for the next one: however many segments are left. Only
 * where a run begins, at a cusp, the vehicle standing, there is an addition for each segment of it.
 */
#ifndef NOSLIP_PATH_H
#define NOSLIP_PATH_H

#include "noslip_controller.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What comes to stand at a cusp and at the end. */
enum {
    NOSLIP_STOP_POINT = 0, /* P_l */
    NOSLIP_STOP_AXLE = 1   /* the middle of the axle: P_l runs on by |L + ahead|, straight */
};

/* Why init refuses a path, and what the size of the fault is then. */
enum {
    NOSLIP_FAULT_NONE = 0,
    NOSLIP_FAULT_EMPTY,     /* there is no segment */
    NOSLIP_FAULT_OPTIONS,   /* an option is not finite, has the wrong sign or is none of its values */
    NOSLIP_FAULT_NONFINITE, /* a number is not finite, or (size, rad) an angle beyond NOSLIP_ANGLE_MAX */
    NOSLIP_FAULT_LENGTH,    /* a length (size, m) that is not positive */
    NOSLIP_FAULT_REVERSING, /* a segment to be driven in reverse, and options.reversing is NOSLIP_REFUSE */
    NOSLIP_FAULT_LEVER,     /* the lever L + ahead (size, m) is zero or has the wrong sign for the direction */
    NOSLIP_FAULT_TIGHT,     /* an arc whose radius falls short by size (m), or misses by 0: the axle cannot go round it */
    NOSLIP_FAULT_GAP,       /* it begins a distance (size, m) from the end of the one before */
    NOSLIP_FAULT_KINK,      /* its direction of travel differs (size, rad) from that at the end of the one before */
    NOSLIP_FAULT_CUSP,      /* reversing begins or ends there, but travel does not turn round by pi (missed by size, rad) */
    NOSLIP_FAULT_SHORT      /* with NOSLIP_STOP_POINT: the run that begins there at a cusp is not longer than P_l moves as it
                               changes sides (missing: size, m), and would be over before it is driven */
};

/* The stage of a piece. */
enum {
    NOSLIP_ALONG = 0,  /* on a segment */
    NOSLIP_BEYOND = 1, /* on the straight extension of the last segment of a run */
    NOSLIP_AT_STOP = 2 /* there too, the stop being reached */
};

#define NOSLIP_TURN ((NOSLIP_REAL)6.283185307179586)

#define NOSLIP_REAL double
#define NOSLIP_LARGEST DBL_MAX
#define NOSLIP_EPSILON DBL_EPSILON
#define NOSLIP_NAME(name) name
#include "noslip_path.inc"
#undef NOSLIP_LARGEST
#undef NOSLIP_EPSILON
#undef NOSLIP_REAL
#undef NOSLIP_NAME

#define NOSLIP_REAL float
#define NOSLIP_LARGEST FLT_MAX
#define NOSLIP_EPSILON FLT_EPSILON
#define NOSLIP_NAME(name) name##_f
#include "noslip_path.inc"
#undef NOSLIP_LARGEST
#undef NOSLIP_EPSILON
#undef NOSLIP_REAL
#undef NOSLIP_NAME

#ifdef __cplusplus
}
#endif

#endif
