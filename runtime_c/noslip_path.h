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
 *      short segments in order, at most one lap. None is skipped.
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

/* -- double: made from noslip_path.inc by guarantees/headers.py -------------------------------------------------------- */

/* A line or an arc. */
typedef struct noslip_segment {
    double x, y;           /* m: where it begins */
    double heading;        /* rad: direction of travel there */
    double curvature;      /* 1/m: positive turns left, 0 is a line */
    double length;         /* m */
    int backward;          /* the vehicle drives it in reverse: its own heading is opposite to the direction of travel */
} noslip_segment;

/* How a path is followed. Zeros mean defaults, but a speed is wanted. */
typedef struct noslip_path_options {
    double speed;             /* m/s, positive: between stops */
    double deceleration;      /* m/s^2: towards a stop; 0: none, the wanted speed falls to 0 at once at the stop */
    double creep;             /* m/s: least wanted speed before a stop, and below it the vehicle stands; 0: 0.01 */
    double gap;               /* m: largest gap between segments; 0: 1e-6, for float 1e-4 */
    double kink;              /* rad: largest change of direction between segments; 0: 1e-6, for float 1e-4 */
    double L[2];              /* m: how far P_l lies ahead of the vehicle's point, going forward [0] and in reverse [1] */
    double W;                 /* m: how far P_l lies to the left of it */
    double ahead;             /* m: how far the vehicle's point lies ahead of the middle of the axle */
    noslip_on_reversing reversing; /* NOSLIP_REFUSE: no segment may be driven in reverse; NOSLIP_SWITCH: then P_l changes sides */
    noslip_path_stop stop;    /* NOSLIP_STOP_POINT or NOSLIP_STOP_AXLE */
    int closed;               /* 1: after the last segment comes the first; 0: it is the end */
} noslip_path_options;

/* The first fault of a path, in the order of its segments; a run that is too short comes after all others. */
typedef struct noslip_path_fault {
    noslip_path_fault_kind kind;
    int segment;      /* from 0; of a fault between two segments the later one; -1: none of them */
    double size;      /* how much, in the unit that the kind says */
} noslip_path_fault;

/* What to follow and where the vehicle is on it. */
typedef struct noslip_guide {
    int segment;                /* from 0; of a straight extension the segment it extends */
    int backward;               /* 1: in reverse */
    int changed;                /* 1: another piece than after the last update, or the first: make a law without `follow` for it */
    int waiting;                /* 1: at a cusp, until |forward_speed| <= creep */
    int arrived;                /* 1: the end is reached */
    double L;                   /* m: of P_l, to use now */
    double x, y;                /* m: where the piece to follow begins, a segment or a straight extension */
    double heading;             /* rad: direction of travel there */
    double curvature;           /* 1/m: positive turns left, 0 is a line */
    double progress;            /* m: of P_l on the piece; negative before its beginning */
    double left;                /* m: until the piece ends, which it does at 0 or below; smooth. While waiting, m/s:
                                   |forward_speed| - creep, which ends it alike. When arrived: the largest number */
    double remaining;           /* m: until the stop, negative beyond; the largest number where there is none */
    noslip_foot foot;              /* P_l seen from its foot on the piece, x in the direction of travel */
    double speed;               /* m/s: wanted forward speed of the vehicle, negative in reverse */
    double speed_rate;          /* m/s^2: its rate along the motion */
} noslip_guide;

/* What is followed, beyond what the guide says of it. Part of noslip_path. */
typedef struct noslip_place {
    noslip_path_stage stage;
    int bent;                 /* 1: an arc; 0: a line, or as good as one */
    double cosine, sine;      /* of the heading where it begins */
    double radius;            /* m: of an arc, 1 / curvature */
    double length;            /* m */
    double rest;              /* m: from its end to the stop; the largest number where there is none */
    double rounded;           /* m: what rounding has put too much into it */
    double cruise;            /* m/s: wanted forward speed far from a stop */
    double slowing;           /* m/s^2: rate of the forward speed towards a stop */
    double least;             /* m: it ends where so much is left; the largest number at a stop, which does not end so */
    double slowest;           /* m/s: a stop ends at such a speed, the last one at none: -1; else the largest number */
} noslip_place;

/* Where a path was before a step, to go back to where that fails; how many pieces have ended, count + 2: no more. Part of it. */
typedef struct noslip_mark {
    int segment;
    noslip_path_stage stage;
    int ended, changed;
    double progress, rest, rounded;
} noslip_mark;

/* The path: made by init, owned by the caller, not to be written to. */
typedef struct noslip_path {
    const noslip_segment *segments;
    int count;
    int closed;
    double speed, deceleration, creep;
    double brake;                    /* m/s^2: 2 deceleration */
    double near;                     /* m: so far from a stop the wanted speed begins to fall, less what rounding could add */
    double L[2];
    double W;
    double run_on[2];                /* m: how far P_l runs on behind a run, going forward [0] and in reverse [1] */
    noslip_place place;
    noslip_mark before;
    noslip_guide guide;              /* as told last: of the piece that is followed */
    int under_way;                   /* NOSLIP_READY after the first update */
    int ready;                       /* set by init */
} noslip_path;

/*
 * Takes a path up, to begin with its first segment. `segments` stay the caller's and have to stay as they are.
 * NOSLIP_BAD_PARAMETER, NOSLIP_BAD_PATH: refused for the reason in `fault`, which may be NULL.
 */
int noslip_path_init(noslip_path *self, const noslip_segment *segments, int count,
        const noslip_path_options *options, noslip_path_fault *fault);

/*
 * The guide at a pose of the vehicle's point (m, rad) and a forward speed (m/s) for the piece that is followed: nothing
 * changes, no piece ends.
 * NOSLIP_ARRIVED after an update that answered so. NOSLIP_RANGE: |heading|, or the angle gone round the centre of an arc,
 * is beyond NOSLIP_ANGLE_MAX. NOSLIP_SINGULAR: P_l is in the centre of the arc.
 */
int noslip_path_look(const noslip_path *self, double x, double y, double heading,
        double forward_speed, noslip_guide *guide);

/*
 * Goes on to the next piece where one has ended, and looks; to be called before every step of the law.
 * NOSLIP_ARRIVED: the end is reached. Errors as noslip_path_look.
 */
int noslip_path_update(noslip_path *self, double x, double y, double heading,
        double forward_speed, noslip_guide *guide);

/* -- inside ------------------------------------------------------------------------------------------------------------ */

/* Where P_l is on a piece. */
typedef struct noslip_found {
    double progress, left;      /* as in the guide */
    noslip_foot foot;
    double shown;      /* finite only if all but `left` is */
} noslip_found;

/* Begins the first step, or says why there is none. */
NOSLIP_COLD int noslip_path_begin(noslip_path *self);

/*
 * Where `status` says that P_l was not found, answers it, and the path is as it was. Else goes on where the piece has ended, not
 * for the first time in this step if `again`: 1 if another is to be looked at now, 0 if the same once more.
 */
NOSLIP_COLD int noslip_path_go_on(noslip_path *self, int status, double forward_speed,
                int again);

/* Ends a step in which it went on. */
NOSLIP_COLD void noslip_path_settle(noslip_path *self);

/* What a guide says at a stop beyond where P_l is, `left` until there; NOSLIP_ARRIVED at the last one. */
int noslip_path_stand(const noslip_path *self, double left, double forward_speed,
        noslip_guide *guide);

/* Finds P_l on the piece, at a pose of the vehicle's point. NOSLIP_SINGULAR, NOSLIP_RANGE, NOSLIP_NONFINITE: of an arc only. */
NOSLIP_HOT int noslip_find(const noslip_path *self, double x, double y,
        const double direction[2], noslip_found *found)
{
    const noslip_place *place = &self->place;
    const noslip_guide *guide = &self->guide;
    const double dx = x - guide->x, dy = y - guide->y;
    const double cosine = place->cosine * direction[0] + place->sine * direction[1];
    const double sine = place->cosine * direction[1] - place->sine * direction[0];
    const double along = place->cosine * dx + place->sine * dy + (guide->L * cosine - self->W * sine);
    const double left = place->cosine * dy - place->sine * dx + (guide->L * sine + self->W * cosine);
    found->progress = along;
    found->foot.distance = left;
    found->foot.cosine = cosine;
    found->foot.sine = sine;
    found->foot.curvature = 0;
    found->shown = left;
    if (place->bent) {
        /* P_l from the centre, in radii: (across, down) is (0, 1) where the arc begins, and points the way to the foot */
        const double curvature = guide->curvature, across = curvature * along, down = 1 - curvature * left;
        const double radii = noslip_sqrt(across * across + down * down);
        double angle, apart, inverse;
        if (!(radii > 16 * DBL_EPSILON)) {
            return radii <= 16 * DBL_EPSILON ? NOSLIP_SINGULAR : NOSLIP_NONFINITE;
        }
        angle = noslip_angle_of(across, down, radii);
        apart = curvature * guide->progress - angle;
        if (!(noslip_abs(apart) <= (double)6.283185307179586 / 2)) {
            angle += (double)6.283185307179586 * noslip_whole_turns(apart);
            if (!noslip_angle_ok(angle)) {
                return noslip_is_finite(radii) ? NOSLIP_RANGE : NOSLIP_NONFINITE;
            }
        }
        inverse = 1 / radii;
        found->progress = angle * place->radius;
        found->foot.distance = (left * (1 + down) - across * along) / (1 + radii);
        found->foot.cosine = (cosine * down + sine * across) * inverse;
        found->foot.sine = (sine * down - cosine * across) * inverse;
        found->foot.curvature = curvature * inverse;
        found->shown = found->foot.distance + found->foot.curvature + radii;
    }
    found->left = place->length - found->progress;
    return NOSLIP_OK;
}

/* The wanted forward speed near a stop, and its rate. */
NOSLIP_HOT void noslip_slow_down(const noslip_path *self, double forward_speed,
               noslip_guide *guide)
{
    double speed = noslip_sqrt(self->brake * guide->remaining), share = 0;
    const int creeps = !(speed > self->creep);
    if (creeps) {
        speed = self->creep < self->speed ? self->creep : self->speed;
    }
    guide->speed = guide->backward ? -speed : speed;
    if (!creeps) {
        /* so the error of the speed dies out by itself: a rate of -deceleration would hold back whoever is too slow */
        share = forward_speed / guide->speed;
        share = share < 0 ? 0 : share > 2 ? 2 : share;
    }
    guide->speed_rate = self->place.slowing * share;
}

/* 1 if all that was found is finite, and the speed too. */
NOSLIP_HOT int noslip_found_finite(const noslip_found *found, double forward_speed)
{
#if defined(__FRAMAC__) /* which cannot tell the parts from the sum */
    return noslip_is_finite(found->left) && noslip_is_finite(found->shown) &&
           noslip_sum_finite(found->foot.distance, found->foot.curvature, forward_speed);
#else
    return noslip_sum_finite(found->left, found->shown, forward_speed);
#endif
}

/* What a guide says of where P_l is. */
NOSLIP_HOT void noslip_tell_foot(const noslip_found *found, noslip_guide *guide)
{
    guide->progress = found->progress;
    guide->foot.distance = found->foot.distance;
    guide->foot.cosine = found->foot.cosine;
    guide->foot.sine = found->foot.sine;
    guide->foot.curvature = found->foot.curvature;
}

/* What it says beyond that at a place that is not at a stop. */
NOSLIP_HOT void noslip_tell_way(const noslip_path *self, double left,
              double forward_speed, noslip_guide *guide)
{
    guide->left = left;
    guide->remaining = left + self->place.rest;
    if (guide->remaining < self->near) {
        noslip_slow_down(self, forward_speed, guide);
    } else {
        if (!(guide->remaining < DBL_MAX)) {
            guide->remaining = DBL_MAX;
        }
        guide->speed = self->place.cruise;
        guide->speed_rate = 0;
    }
}

/*
 * noslip_path_update where cosine and sine of the heading are known, `direction`: the guide is self->guide, and on an error it
 * is as it was, as is the path. Errors as noslip_path_update, but none for the heading.
 */
NOSLIP_HOT int noslip_path_step(noslip_path *self, double x, double y,
         const double direction[2], double forward_speed)
{
    int status, more, again = 0;
    if (self == NULL || direction == NULL) {
        return NOSLIP_NULL;
    }
    if (self->under_way != NOSLIP_READY) {
        status = noslip_path_begin(self);
        if (status < 0) {
            return status;
        }
        again = 1;
    }
    do {
        noslip_found found;
        int finite;
        more = 0;
        status = noslip_find(self, x, y, direction, &found);
        finite = status == NOSLIP_OK && noslip_found_finite(&found, forward_speed);
        if (finite && found.left > self->place.least) {
            noslip_tell_foot(&found, &self->guide);
            noslip_tell_way(self, found.left, forward_speed, &self->guide);
        } else if (finite && noslip_abs(forward_speed) > self->place.slowest) {
            noslip_tell_foot(&found, &self->guide);
            status = noslip_path_stand(self, found.left, forward_speed, &self->guide);
        } else {
            status = status == NOSLIP_OK && !finite ? NOSLIP_NONFINITE : status;
            status = noslip_path_go_on(self, status, forward_speed, again);
            more = status >= 0;
            again = 1;
        }
    } while (more);
    if (status >= 0) {
        self->guide.changed = 0;
        if (again) {
            noslip_path_settle(self);
        }
    }
    return status;
}

/* -- float: made from noslip_path.inc by guarantees/headers.py --------------------------------------------------------- */

/* A line or an arc. */
typedef struct noslip_segment_f {
    float x, y;            /* m: where it begins */
    float heading;         /* rad: direction of travel there */
    float curvature;       /* 1/m: positive turns left, 0 is a line */
    float length;          /* m */
    int backward;          /* the vehicle drives it in reverse: its own heading is opposite to the direction of travel */
} noslip_segment_f;

/* How a path is followed. Zeros mean defaults, but a speed is wanted. */
typedef struct noslip_path_options_f {
    float speed;              /* m/s, positive: between stops */
    float deceleration;       /* m/s^2: towards a stop; 0: none, the wanted speed falls to 0 at once at the stop */
    float creep;              /* m/s: least wanted speed before a stop, and below it the vehicle stands; 0: 0.01 */
    float gap;                /* m: largest gap between segments; 0: 1e-6, for float 1e-4 */
    float kink;               /* rad: largest change of direction between segments; 0: 1e-6, for float 1e-4 */
    float L[2];               /* m: how far P_l lies ahead of the vehicle's point, going forward [0] and in reverse [1] */
    float W;                  /* m: how far P_l lies to the left of it */
    float ahead;              /* m: how far the vehicle's point lies ahead of the middle of the axle */
    noslip_on_reversing reversing; /* NOSLIP_REFUSE: no segment may be driven in reverse; NOSLIP_SWITCH: then P_l changes sides */
    noslip_path_stop stop;    /* NOSLIP_STOP_POINT or NOSLIP_STOP_AXLE */
    int closed;               /* 1: after the last segment comes the first; 0: it is the end */
} noslip_path_options_f;

/* The first fault of a path, in the order of its segments; a run that is too short comes after all others. */
typedef struct noslip_path_fault_f {
    noslip_path_fault_kind kind;
    int segment;      /* from 0; of a fault between two segments the later one; -1: none of them */
    float size;       /* how much, in the unit that the kind says */
} noslip_path_fault_f;

/* What to follow and where the vehicle is on it. */
typedef struct noslip_guide_f {
    int segment;                /* from 0; of a straight extension the segment it extends */
    int backward;               /* 1: in reverse */
    int changed;                /* 1: another piece than after the last update, or the first: make a law without `follow` for it */
    int waiting;                /* 1: at a cusp, until |forward_speed| <= creep */
    int arrived;                /* 1: the end is reached */
    float L;                    /* m: of P_l, to use now */
    float x, y;                 /* m: where the piece to follow begins, a segment or a straight extension */
    float heading;              /* rad: direction of travel there */
    float curvature;            /* 1/m: positive turns left, 0 is a line */
    float progress;             /* m: of P_l on the piece; negative before its beginning */
    float left;                 /* m: until the piece ends, which it does at 0 or below; smooth. While waiting, m/s:
                                   |forward_speed| - creep, which ends it alike. When arrived: the largest number */
    float remaining;            /* m: until the stop, negative beyond; the largest number where there is none */
    noslip_foot_f foot;            /* P_l seen from its foot on the piece, x in the direction of travel */
    float speed;                /* m/s: wanted forward speed of the vehicle, negative in reverse */
    float speed_rate;           /* m/s^2: its rate along the motion */
} noslip_guide_f;

/* What is followed, beyond what the guide says of it. Part of noslip_path. */
typedef struct noslip_place_f {
    noslip_path_stage stage;
    int bent;                 /* 1: an arc; 0: a line, or as good as one */
    float cosine, sine;       /* of the heading where it begins */
    float radius;             /* m: of an arc, 1 / curvature */
    float length;             /* m */
    float rest;               /* m: from its end to the stop; the largest number where there is none */
    float rounded;            /* m: what rounding has put too much into it */
    float cruise;             /* m/s: wanted forward speed far from a stop */
    float slowing;            /* m/s^2: rate of the forward speed towards a stop */
    float least;              /* m: it ends where so much is left; the largest number at a stop, which does not end so */
    float slowest;            /* m/s: a stop ends at such a speed, the last one at none: -1; else the largest number */
} noslip_place_f;

/* Where a path was before a step, to go back to where that fails; how many pieces have ended, count + 2: no more. Part of it. */
typedef struct noslip_mark_f {
    int segment;
    noslip_path_stage stage;
    int ended, changed;
    float progress, rest, rounded;
} noslip_mark_f;

/* The path: made by init, owned by the caller, not to be written to. */
typedef struct noslip_path_f {
    const noslip_segment_f *segments;
    int count;
    int closed;
    float speed, deceleration, creep;
    float brake;                     /* m/s^2: 2 deceleration */
    float near;                      /* m: so far from a stop the wanted speed begins to fall, less what rounding could add */
    float L[2];
    float W;
    float run_on[2];                 /* m: how far P_l runs on behind a run, going forward [0] and in reverse [1] */
    noslip_place_f place;
    noslip_mark_f before;
    noslip_guide_f guide;            /* as told last: of the piece that is followed */
    int under_way;                   /* NOSLIP_READY after the first update */
    int ready;                       /* set by init */
} noslip_path_f;

/*
 * Takes a path up, to begin with its first segment. `segments` stay the caller's and have to stay as they are.
 * NOSLIP_BAD_PARAMETER, NOSLIP_BAD_PATH: refused for the reason in `fault`, which may be NULL.
 */
int noslip_path_init_f(noslip_path_f *self, const noslip_segment_f *segments, int count,
        const noslip_path_options_f *options, noslip_path_fault_f *fault);

/*
 * The guide at a pose of the vehicle's point (m, rad) and a forward speed (m/s) for the piece that is followed: nothing
 * changes, no piece ends.
 * NOSLIP_ARRIVED after an update that answered so. NOSLIP_RANGE: |heading|, or the angle gone round the centre of an arc,
 * is beyond NOSLIP_ANGLE_MAX. NOSLIP_SINGULAR: P_l is in the centre of the arc.
 */
int noslip_path_look_f(const noslip_path_f *self, float x, float y, float heading,
        float forward_speed, noslip_guide_f *guide);

/*
 * Goes on to the next piece where one has ended, and looks; to be called before every step of the law.
 * NOSLIP_ARRIVED: the end is reached. Errors as noslip_path_look.
 */
int noslip_path_update_f(noslip_path_f *self, float x, float y, float heading,
        float forward_speed, noslip_guide_f *guide);

/* -- inside ------------------------------------------------------------------------------------------------------------ */

/* Where P_l is on a piece. */
typedef struct noslip_found_f {
    float progress, left;       /* as in the guide */
    noslip_foot_f foot;
    float shown;       /* finite only if all but `left` is */
} noslip_found_f;

/* Begins the first step, or says why there is none. */
NOSLIP_COLD int noslip_path_begin_f(noslip_path_f *self);

/*
 * Where `status` says that P_l was not found, answers it, and the path is as it was. Else goes on where the piece has ended, not
 * for the first time in this step if `again`: 1 if another is to be looked at now, 0 if the same once more.
 */
NOSLIP_COLD int noslip_path_go_on_f(noslip_path_f *self, int status, float forward_speed,
                   int again);

/* Ends a step in which it went on. */
NOSLIP_COLD void noslip_path_settle_f(noslip_path_f *self);

/* What a guide says at a stop beyond where P_l is, `left` until there; NOSLIP_ARRIVED at the last one. */
int noslip_path_stand_f(const noslip_path_f *self, float left, float forward_speed,
        noslip_guide_f *guide);

/* Finds P_l on the piece, at a pose of the vehicle's point. NOSLIP_SINGULAR, NOSLIP_RANGE, NOSLIP_NONFINITE: of an arc only. */
NOSLIP_HOT int noslip_find_f(const noslip_path_f *self, float x, float y,
        const float direction[2], noslip_found_f *found)
{
    const noslip_place_f *place = &self->place;
    const noslip_guide_f *guide = &self->guide;
    const float dx = x - guide->x, dy = y - guide->y;
    const float cosine = place->cosine * direction[0] + place->sine * direction[1];
    const float sine = place->cosine * direction[1] - place->sine * direction[0];
    const float along = place->cosine * dx + place->sine * dy + (guide->L * cosine - self->W * sine);
    const float left = place->cosine * dy - place->sine * dx + (guide->L * sine + self->W * cosine);
    found->progress = along;
    found->foot.distance = left;
    found->foot.cosine = cosine;
    found->foot.sine = sine;
    found->foot.curvature = 0;
    found->shown = left;
    if (place->bent) {
        /* P_l from the centre, in radii: (across, down) is (0, 1) where the arc begins, and points the way to the foot */
        const float curvature = guide->curvature, across = curvature * along, down = 1 - curvature * left;
        const float radii = noslip_sqrt_f(across * across + down * down);
        float angle, apart, inverse;
        if (!(radii > 16 * FLT_EPSILON)) {
            return radii <= 16 * FLT_EPSILON ? NOSLIP_SINGULAR : NOSLIP_NONFINITE;
        }
        angle = noslip_angle_of_f(across, down, radii);
        apart = curvature * guide->progress - angle;
        if (!(noslip_abs_f(apart) <= (float)6.283185307179586 / 2)) {
            angle += (float)6.283185307179586 * noslip_whole_turns_f(apart);
            if (!noslip_angle_ok_f(angle)) {
                return noslip_is_finite_f(radii) ? NOSLIP_RANGE : NOSLIP_NONFINITE;
            }
        }
        inverse = 1 / radii;
        found->progress = angle * place->radius;
        found->foot.distance = (left * (1 + down) - across * along) / (1 + radii);
        found->foot.cosine = (cosine * down + sine * across) * inverse;
        found->foot.sine = (sine * down - cosine * across) * inverse;
        found->foot.curvature = curvature * inverse;
        found->shown = found->foot.distance + found->foot.curvature + radii;
    }
    found->left = place->length - found->progress;
    return NOSLIP_OK;
}

/* The wanted forward speed near a stop, and its rate. */
NOSLIP_HOT void noslip_slow_down_f(const noslip_path_f *self, float forward_speed,
                  noslip_guide_f *guide)
{
    float speed = noslip_sqrt_f(self->brake * guide->remaining), share = 0;
    const int creeps = !(speed > self->creep);
    if (creeps) {
        speed = self->creep < self->speed ? self->creep : self->speed;
    }
    guide->speed = guide->backward ? -speed : speed;
    if (!creeps) {
        /* so the error of the speed dies out by itself: a rate of -deceleration would hold back whoever is too slow */
        share = forward_speed / guide->speed;
        share = share < 0 ? 0 : share > 2 ? 2 : share;
    }
    guide->speed_rate = self->place.slowing * share;
}

/* 1 if all that was found is finite, and the speed too. */
NOSLIP_HOT int noslip_found_finite_f(const noslip_found_f *found, float forward_speed)
{
#if defined(__FRAMAC__) /* which cannot tell the parts from the sum */
    return noslip_is_finite_f(found->left) && noslip_is_finite_f(found->shown) &&
           noslip_sum_finite_f(found->foot.distance, found->foot.curvature, forward_speed);
#else
    return noslip_sum_finite_f(found->left, found->shown, forward_speed);
#endif
}

/* What a guide says of where P_l is. */
NOSLIP_HOT void noslip_tell_foot_f(const noslip_found_f *found, noslip_guide_f *guide)
{
    guide->progress = found->progress;
    guide->foot.distance = found->foot.distance;
    guide->foot.cosine = found->foot.cosine;
    guide->foot.sine = found->foot.sine;
    guide->foot.curvature = found->foot.curvature;
}

/* What it says beyond that at a place that is not at a stop. */
NOSLIP_HOT void noslip_tell_way_f(const noslip_path_f *self, float left,
                 float forward_speed, noslip_guide_f *guide)
{
    guide->left = left;
    guide->remaining = left + self->place.rest;
    if (guide->remaining < self->near) {
        noslip_slow_down_f(self, forward_speed, guide);
    } else {
        if (!(guide->remaining < FLT_MAX)) {
            guide->remaining = FLT_MAX;
        }
        guide->speed = self->place.cruise;
        guide->speed_rate = 0;
    }
}

/*
 * noslip_path_update where cosine and sine of the heading are known, `direction`: the guide is self->guide, and on an error it
 * is as it was, as is the path. Errors as noslip_path_update, but none for the heading.
 */
NOSLIP_HOT int noslip_path_step_f(noslip_path_f *self, float x, float y,
           const float direction[2], float forward_speed)
{
    int status, more, again = 0;
    if (self == NULL || direction == NULL) {
        return NOSLIP_NULL;
    }
    if (self->under_way != NOSLIP_READY) {
        status = noslip_path_begin_f(self);
        if (status < 0) {
            return status;
        }
        again = 1;
    }
    do {
        noslip_found_f found;
        int finite;
        more = 0;
        status = noslip_find_f(self, x, y, direction, &found);
        finite = status == NOSLIP_OK && noslip_found_finite_f(&found, forward_speed);
        if (finite && found.left > self->place.least) {
            noslip_tell_foot_f(&found, &self->guide);
            noslip_tell_way_f(self, found.left, forward_speed, &self->guide);
        } else if (finite && noslip_abs_f(forward_speed) > self->place.slowest) {
            noslip_tell_foot_f(&found, &self->guide);
            status = noslip_path_stand_f(self, found.left, forward_speed, &self->guide);
        } else {
            status = status == NOSLIP_OK && !finite ? NOSLIP_NONFINITE : status;
            status = noslip_path_go_on_f(self, status, forward_speed, again);
            more = status >= 0;
            again = 1;
        }
    } while (more);
    if (status >= 0) {
        self->guide.changed = 0;
        if (again) {
            noslip_path_settle_f(self);
        }
    }
    return status;
}

/* -- end of what is made ----------------------------------------------------------------------------------------------- */

#ifdef __cplusplus
}
#endif

#endif
