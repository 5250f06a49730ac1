/*
 * grip.c - the law LAW of ROBOT with NOSLIP_GRIP for EVA, in the scalar REAL with SUFFIX; SOURCE is its C, included here so that
 * what it calls can be watched.
 *
 * The claim "friction use is at most 1 unless the status says otherwise" has three parts. Where a step returns NOSLIP_OK or
 * NOSLIP_GRIP_LIMITED, noslip_holds has answered yes for every contact after the inputs were changed for the last time
 * (check_step). Inputs that go from there to noslip_apply_limits are not changed by it: they are within their limits
 * (watched_apply_limits). With a force of 1.11 times the friction or more, noslip_holds answers no
 * (check_holds): intervals prove that with a factor only. Between 1 and 1.11 the rounding of its five operations decides, see
 * noslip_holds. What is believed of mu stays from 0 to the most that may be believed. Not proved, but tested: that the forces are those of the model.
 */
#include "eva.h"
#include HEADER

#define OF_LAW(name) OF(GLUE(LAW, name))
#define OF_ROBOT(name) OF(GLUE(ROBOT, name))
#define INPUTS COUNT(((OF_LAW() *)0)->held)
#define CONTACTS 2

static int kept; /* contacts in a row that are within friction, since the inputs changed */

static int watched_holds(const REAL *ground, const OF(noslip_grip) * grip)
{
    const int holds = OF(noslip_holds)(ground, grip);
    kept = holds ? kept + 1 : 0;
    return holds;
}

static int watched_keep_grip(REAL *inputs, const REAL *slope, REAL *ground, const REAL *by_inputs, const OF(noslip_grip) * grip,
                             const REAL *limits, int contacts, REAL *work)
{
    kept = 0;
    return OF(noslip_keep_grip)(inputs, slope, ground, by_inputs, grip, limits, contacts, work);
}

/* The inputs of a step that is limited by grip are not changed on the way to the caller. */
static int watched_apply_limits(int status, int on_error, const REAL *limits, REAL *held, const REAL *computed, REAL *inputs, int count)
{
    int k;
    for (k = 0; k < count; k++) {
        const REAL input = computed[k], most = limits[k];
        if (status == NOSLIP_GRIP_LIMITED) {
            REACHED(within_limits);
            /*@ assert -most <= input <= most; */
        }
    }
    return OF(noslip_apply_limits)(status, on_error, limits, held, computed, inputs, count);
}

#define noslip_holds watched_holds
#define noslip_holds_f watched_holds
#define noslip_keep_grip watched_keep_grip
#define noslip_keep_grip_f watched_keep_grip
#define noslip_apply_limits watched_apply_limits
#define noslip_apply_limits_f watched_apply_limits
#include SOURCE
#undef noslip_holds
#undef noslip_holds_f

/* step or follow, with arbitrary bits in state, reference, foot and the law except for its limits, held inputs and friction. */
void check_step(int follow, REAL odd, REAL even)
{
    OF_ROBOT(_state) state;
    OF_LAW(_reference) reference;
    OF(noslip_foot) foot;
    OF_LAW() law;
    REAL tau[INPUTS];
    int status, k;
    ANY(state);
    ANY(reference);
    ANY(foot);
    ANY(law);
    law.on_error = NOSLIP_ZERO;
    law.on_limit = NOSLIP_GRIP;
    for (k = 0; k < INPUTS; k++) {
        law.limit[k] = k % 2 ? odd : even;
        law.clear[k] = -1;
        law.held[k] = 0;
    }
    law.earned.most = 1; /* all else of it has arbitrary bits */
    law.earned.mu = BETWEEN(0, 1);
    kept = 0;
#if FOLLOWS
    if (follow) {
        status = OF_LAW(_follow)(&law, &foot, &state, &reference, tau);
    } else
#endif
    {
        status = OF_LAW(_step)(&law, &state, &reference, tau);
    }
    /*@ assert 0 <= law.earned.mu <= 1; */
    if (status == NOSLIP_OK) {
        REACHED(rolls);
        /*@ assert kept == CONTACTS; */
    } else if (status == NOSLIP_GRIP_LIMITED) {
        REACHED(limited);
        /*@ assert kept == CONTACTS; */
    } else if (status > 0) {
        REACHED(will_slip);
        /*@ assert status == NOSLIP_WILL_SLIP; */
    }
}

/*
 * The answer at a contact with a force of at least 1.11 times its friction, or of a negative friction. The friction is from 1 to 2 N:
 * beyond that, all numbers are the same times a power of two. Boxes of forces cover what is outside the circle.
 */
void check_holds(void)
{
    const REAL width = 1 / (REAL)32;
    OF(noslip_grip) grip;
    REAL ground[4], most, along, across;
    int quarter, answer;
    ground[2] = 0;
    ground[3] = 1;
    grip.height = 0;
    /*@ loop unroll 30; */
    for (most = 1; most < 2; most += most * width) {
        const REAL end = most * (1 + width), step = end * width, beyond = end * (1 + width);
        grip.weight = BETWEEN(most, end);
        across = beyond;
        /*@ loop unroll 60; */
        for (along = 0; along < beyond; along += step) {
            /*@ loop unroll 60; */
            while (across > step && along * along + (across - step) * (across - step) >= beyond * beyond) {
                across -= step;
            }
            for (quarter = 0; quarter < 4; quarter++) {
                ground[0] = quarter % 2 ? BETWEEN(along, along + step) : BETWEEN(-along - step, -along);
                ground[1] = quarter / 2 ? BETWEEN(across, LARGEST) : BETWEEN(-LARGEST, -across);
                answer = OF(noslip_holds)(ground, &grip);
                REACHED(outside);
                /*@ assert answer == 0; */
            }
        }
        for (quarter = 0; quarter < 2; quarter++) {
            ground[0] = quarter ? BETWEEN(beyond, LARGEST) : BETWEEN(-LARGEST, -beyond);
            ground[1] = BETWEEN(-LARGEST, LARGEST);
            answer = OF(noslip_holds)(ground, &grip);
            /*@ assert answer == 0; */
        }
    }
    ANY(ground);
    ground[2] = 0;
    ground[3] = 1;
    grip.weight = BETWEEN(-LARGEST, -1);
    answer = OF(noslip_holds)(ground, &grip);
    REACHED(negative_load);
    /*@ assert answer == 0; */
}

int main(void)
{
    int follow;
    for (follow = 0; follow <= FOLLOWS; follow++) {
        check_step(follow, SMALLEST, LARGEST);
        check_step(follow, 20, 7);
        check_step(follow, LARGEST, LARGEST);
    }
    check_holds();
    REACHED(end);
    return 0;
}
