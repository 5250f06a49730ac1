/*
 * slip.c - noticing slip and speed profiles for EVA, in the scalar REAL with SUFFIX: arbitrary bits in all arguments.
 *
 * Proved is that nothing undefined happens, and what init establishes. That what is noticed and the speed of a profile are finite
 * needs relations that intervals do not represent; the fuzzers check it.
 */
#include "eva.h"
#include "noslip_profile.h"
#include "noslip_slip.h"

#define SEGMENTS 3

void check_slip(void)
{
    OF(noslip_slip) self;
    OF(noslip_slip_options) options;
    OF(noslip_slip_reading) reading;
    OF(noslip_odometry_options) vehicle;
    OF(noslip_noticed) noticed;
    OF(noslip_earned) earned;
    OF(noslip_grip) grip;
    int status;
    ANY(self);
    ANY(options);
    ANY(vehicle);
    status = OF(noslip_slip_init)(&self, &options, &vehicle);
    if (status == NOSLIP_OK) {
        REACHED(slip_init_good);
        /*@ assert self.ready == NOSLIP_READY && \is_finite(self.noticed.mu); */
    } else {
        REACHED(slip_init_refused);
        /*@ assert self.ready == 0; */
    }
    ANY(self);
    ANY(reading);
    self.options.least = BETWEEN(SMALLEST, LARGEST);
    self.options.mu = BETWEEN(SMALLEST, LARGEST);
    self.noticed.mu = BETWEEN(0, LARGEST);
    self.noticed.uncertain_heading = BETWEEN(0, LARGEST);
    self.noticed.uncertain_way = BETWEEN(0, LARGEST);
    self.noticed.heading_difference = BETWEEN(-LARGEST, LARGEST);
    self.noticed.speed_difference = BETWEEN(-LARGEST, LARGEST);
    status = OF(noslip_slip_step)(&self, &reading, any_real(), &noticed);
    if (status >= 0) {
        REACHED(slip_good);
    } else {
        REACHED(slip_refused);
    }
    ANY(earned);
    status = OF(noslip_slip_grip)(&self, &earned, &grip);
    status += OF(noslip_slip_trust)(&self);
}

void check_profile(int count)
{
    OF(noslip_segment) segments[SEGMENTS];
    OF(noslip_path_options) options;
    OF(noslip_profile_limits) limits;
    OF(noslip_profile) self;
    OF(noslip_guide) guide;
    REAL squares[SEGMENTS], speed, rate;
    int status;
    ANY(segments);
    ANY(options);
    ANY(limits);
    ANY(self);
    ANY(guide);
    status = OF(noslip_profile_init)(&self, segments, count, &options, &limits, squares);
    if (status == NOSLIP_OK) {
        REACHED(profile_init_good);
        /*@ assert self.count == count && self.ready == NOSLIP_READY; */
        status = OF(noslip_profile_speed)(&self, &guide, any_real(), &speed, &rate);
        /*@ assert \is_finite(speed) && \is_finite(rate); */
        if (status == NOSLIP_OK) {
            REACHED(profile_good);
        } else {
            REACHED(profile_refused);
        }
    } else {
        REACHED(profile_init_refused);
        /*@ assert self.ready == 0; */
    }
}

int main(void)
{
    check_slip();
    check_profile(SEGMENTS);
    REACHED(end);
    return 0;
}
