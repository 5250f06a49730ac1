/*
 * runtime.c - odometry, encoder, integral action, disturbance observer, reversing and angles for EVA, in the scalar REAL with SUFFIX.
 *
 * Functions are proved to keep the properties that init establishes, so that the results hold for any sequence of calls.
 */
#include "eva.h"
#include "noslip_angle.h"
#include "noslip_disturbance.h"
#include "noslip_integral.h"
#include "noslip_odometry.h"
#include "noslip_reversing.h"

/*@ predicate is_pose(OF(noslip_pose) p) = \is_finite(p.x) && \is_finite(p.y) && -ANGLE_MAX <= p.heading <= ANGLE_MAX; */

/* Asserts the properties of an odometry that is ready. */
void check_odometry_is_sound(const OF(noslip_odometry) *self)
{
    if (self->ready == NOSLIP_READY) {
        /*@ assert -ANGLE_MAX <= self->now.at[2] <= ANGLE_MAX; */
        /*@ assert is_pose(self->pose); */
    }
}

/* Any odometry with these properties. */
void make_odometry(OF(noslip_odometry) *self)
{
    ANY(*self);
    self->now.at[2] = BETWEEN(-ANGLE_MAX, ANGLE_MAX);
    self->pose.x = BETWEEN(-LARGEST, LARGEST);
    self->pose.y = BETWEEN(-LARGEST, LARGEST);
    self->pose.heading = BETWEEN(-ANGLE_MAX, ANGLE_MAX);
}

void check_odometry(void)
{
    OF(noslip_odometry) self;
    OF(noslip_odometry_options) options;
    OF(noslip_pose) pose;
    REAL angle[2];
    int status;
    ANY(options);
    ANY(self);
    ANY(pose);
    ANY(angle);
    status = OF(noslip_odometry_init)(&self, &options, any_int ? &pose : NULL);
    if (status >= 0) {
        REACHED(odometry_init_good);
    } else {
        REACHED(odometry_init_refused);
    }
    /*@ assert status == NOSLIP_OK <==> self.ready == NOSLIP_READY; */
    check_odometry_is_sound(&self);

    make_odometry(&self);
    status = OF(noslip_odometry_move)(&self, angle, any_real(), &pose);
    if (status >= 0) {
        REACHED(move_good);
    } else {
        REACHED(move_refused);
    }
    /*@ assert is_pose(pose); */
    check_odometry_is_sound(&self);

    make_odometry(&self);
    status = OF(noslip_odometry_rates)(&self, angle, any_real(), &pose);
    if (status >= 0) {
        REACHED(rates_good);
    } else {
        REACHED(rates_refused);
    }
    /*@ assert is_pose(pose); */
    check_odometry_is_sound(&self);

    make_odometry(&self);
    ANY(pose);
    status = OF(noslip_odometry_correct)(&self, &pose, any_int);
    if (status >= 0) {
        REACHED(correct_good);
    } else {
        REACHED(correct_refused);
    }
    check_odometry_is_sound(&self);

    make_odometry(&self);
    status = OF(noslip_odometry_unwind)(&self);
    if (status >= 0) {
        REACHED(unwind_good);
    } else {
        REACHED(unwind_refused);
    }
    check_odometry_is_sound(&self);

    make_odometry(&self);
    ANY(pose);
    status = OF(noslip_odometry_pose)(&self, &pose);
    if (status >= 0) {
        REACHED(pose_good);
    } else {
        REACHED(pose_refused);
    }
    /*@ assert is_pose(pose); */

    status = OF(noslip_odometry_differential)(&options, any_real(), any_real(), any_real());
    if (status >= 0) {
        REACHED(differential_good);
    } else {
        REACHED(differential_refused);
    }
    /*@ assert \is_finite(options.ahead) && options.release == 0; */
}

void check_encoder(void)
{
    OF(noslip_encoder) self;
    REAL angle;
    int status;
    ANY(self);
    status = OF(noslip_encoder_init)(&self, any_real(), any_int);
    if (status >= 0) {
        REACHED(encoder_init_good);
    } else {
        REACHED(encoder_init_refused);
    }
    if (status == NOSLIP_OK) {
        /*@ assert \is_finite(self.scale) && \is_finite(self.rest) && self.carry == 0 && self.started == 0 && self.ready == NOSLIP_READY; */
    } else {
        /*@ assert self.ready == 0; */
    }
    ANY(self);
    self.scale = BETWEEN(-7, 7);
    self.rest = BETWEEN(-7, 7);
    self.carry = BETWEEN(-7, 7);
    status = OF(noslip_encoder_read)(&self, (uint32_t)any_int, &angle);
    if (status >= 0) {
        REACHED(read_good);
    } else {
        REACHED(read_refused);
    }
    /*@ assert \is_finite(angle); */
    /*@ assert status == NOSLIP_OK || angle == 0; */
}

void check_integral_init(void)
{
    OF(noslip_integral) self;
    int status;
    ANY(self);
    status = OF(noslip_integral_init)(&self, any_real(), any_real());
    if (status >= 0) {
        REACHED(integral_init_good);
    } else {
        REACHED(integral_init_refused);
    }
    if (status == NOSLIP_OK) {
        /*@ assert \is_finite(self.ki) && self.ki >= 0 && \is_finite(self.limit) && self.limit > 0; */
        /*@ assert self.added == 0; */
    } else {
        /*@ assert self.ready == 0; */
    }
}

/* With specific numbers as limits, as in check_step of law.c. */
void check_integral_step(REAL limit)
{
    OF(noslip_integral) self;
    REAL added;
    int status;
    ANY(self);
    self.limit = limit;
    self.added = BETWEEN(-limit, limit);
    status = any_int ? OF(noslip_integral_step)(&self, any_real(), any_real(), any_int, &added)
                     : OF(noslip_integral_reset)(&self, any_real());
    /*@ assert \is_finite(self.added) && -limit <= self.added <= limit && self.limit == limit; */
    status = OF(noslip_integral_step)(&self, any_real(), any_real(), any_int, &added);
    if (status >= 0) {
        REACHED(integral_good);
    } else {
        REACHED(integral_refused);
    }
    /*@ assert \is_finite(added) && -limit <= added <= limit; */
}

/* After an init that is not refused, two steps or a reset and a step. */
void check_disturbance(REAL limit)
{
    OF(noslip_disturbance) self;
    REAL added;
    int status;
    ANY(self);
    status = OF(noslip_disturbance_init)(&self, any_real(), limit);
    if (status < 0) {
        REACHED(disturbance_init_refused);
        /*@ assert self.ready == 0; */
        return;
    }
    /*@ assert \is_finite(self.rate) && self.rate >= 0 && self.limit == limit; */
    status = any_int ? OF(noslip_disturbance_step)(&self, any_real(), any_real(), any_real(), any_int, &added)
                     : OF(noslip_disturbance_reset)(&self, any_real());
    (void)OF(noslip_disturbance_applied)(&self, any_real());
    status = OF(noslip_disturbance_step)(&self, any_real(), any_real(), any_real(), any_int, &added);
    if (status >= 0) {
        REACHED(disturbance_good);
    } else {
        REACHED(disturbance_refused);
    }
    /*@ assert \is_finite(added) && -limit <= added <= limit; */
}

void check_angles(void)
{
    REAL lookahead[2], nearest;
    int status, which;
    ANY(lookahead);
    which = any_int;
    status = OF(noslip_reversing)(any_int, any_real(), lookahead, &which);
    if (status >= 0) {
        REACHED(reversing_good);
    } else {
        REACHED(reversing_refused);
    }
    /*@ assert status == NOSLIP_OK ==> which == 0 || which == 1; */
    status = OF(noslip_nearest_angle)(any_real(), any_real(), &nearest);
    if (status >= 0) {
        REACHED(nearest_angle_good);
    } else {
        REACHED(nearest_angle_refused);
    }
    /*@ assert \is_finite(nearest) && -4 * ANGLE_MAX <= nearest <= 4 * ANGLE_MAX; */
    /*@ assert status == NOSLIP_OK || nearest == 0; */
}

int main(void)
{
    check_odometry();
    check_encoder();
    check_integral_init();
    check_integral_step(SMALLEST);
    check_integral_step(20);
    check_integral_step(LARGEST);
    check_disturbance(20);
    check_disturbance(LARGEST);
    check_angles();
    REACHED(end);
    return 0;
}
