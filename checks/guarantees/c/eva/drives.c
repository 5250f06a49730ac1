/*
 * drives.c - motor, velocity commands and watchdog for EVA, in the scalar REAL with SUFFIX.
 *
 * As in law.c, a result is compared with limits that are specific numbers. The watchdog is proved to keep the properties that init
 * establishes, for several numbers of strikes, so that the results hold for any sequence of ticks.
 */
#include "eva.h"
#include "noslip_motor.h"
#include "noslip_velocity.h"
#include "noslip_watchdog.h"

/* init with arbitrary bits: a motor that is ready has finite and positive limits. */
void check_motor_init(void)
{
    OF(noslip_motor_settings) settings;
    OF(noslip_motor) self;
    int status;
    ANY(settings);
    ANY(self);
    status = OF(noslip_motor_init)(&self, &settings);
    if (status >= 0) {
        REACHED(motor_init_good);
        /*@ assert status == NOSLIP_OK && self.ready == NOSLIP_READY; */
        /*@ assert NOSLIP_MOTOR_TORQUE <= self.mode <= NOSLIP_MOTOR_DUTY; */
        /*@ assert \is_finite(self.current) && self.current > 0 && \is_finite(self.supply) && self.supply > 0; */
        /*@ assert \is_finite(self.standing) && self.standing > 0; */
        /*@ assert \is_finite(self.back_emf) && \is_finite(self.per_torque) && \is_finite(self.back_change); */
    } else {
        REACHED(motor_init_refused);
        /*@ assert self.ready == 0; */
    }
}

/* A step with arbitrary bits in torque, rate and the constants of the motor, but for its limits and a positive resistance: the command
 * is within the limits, and 0 with an error. */
void check_motor_step(noslip_motor_mode mode, REAL current, REAL supply, REAL most)
{
    OF(noslip_motor) self;
    REAL command = any_real();
    int status;
    ANY(self);
    self.mode = mode;
    self.current = current;
    self.supply = supply;
    self.resistance = BETWEEN(SMALLEST, LARGEST);
    status = OF(noslip_motor_step)(&self, any_real(), any_real(), &command);
    if (status == NOSLIP_OK) {
        REACHED(motor_step_good);
    } else if (status > 0) {
        REACHED(motor_step_saturated);
    } else {
        REACHED(motor_step_refused);
        /*@ assert command == 0; */
    }
    /*@ assert status <= NOSLIP_SATURATED && status >= NOSLIP_NOT_READY; */
    /*@ assert \is_finite(command) && -most <= command <= most; */
}

/* The limit at arbitrary rates, of motors of usual size: finite, at least 1/20 of that at standstill, and 0 with an error. */
void check_motor_limit(void)
{
    OF(noslip_motor) self;
    REAL torque = any_real();
    int status;
    ANY(self);
    self.per_torque = BETWEEN((REAL)0.001, 1000);
    self.current = BETWEEN((REAL)0.01, 1000);
    self.resistance = BETWEEN((REAL)0.001, 1000);
    self.supply = BETWEEN(1, 1000);
    self.back_emf = BETWEEN(-100, 100);
    self.friction = BETWEEN(0, 100);
    self.dry_friction = BETWEEN(0, 100);
    self.per_moving = BETWEEN((REAL)0.001, 1000);
    self.standing = 20;
    self.mode = Frama_C_interval(NOSLIP_MOTOR_CURRENT, NOSLIP_MOTOR_DUTY);
    status = OF(noslip_motor_limit)(&self, any_real(), &torque);
    if (status >= 0) {
        REACHED(motor_limit_good);
        /*@ assert status == NOSLIP_OK && torque >= 0.99; */
    } else {
        REACHED(motor_limit_refused);
        /*@ assert torque == 0; */
    }
    /*@ assert \is_finite(torque); */

    ANY(self);
    self.supply = 24;
    status = OF(noslip_motor_set_supply)(&self, any_real());
    if (status >= 0) {
        REACHED(set_supply_good);
    } else {
        REACHED(set_supply_refused);
    }
    /*@ assert \is_finite(self.supply) && self.supply > 0; */
}

/* init with arbitrary bits: commands of zero, and limits that are finite and positive. */
void check_velocity_init(int count)
{
    OF(noslip_velocity_limits) limits[NOSLIP_VELOCITIES];
    OF(noslip_velocity_vehicle) vehicle;
    OF(noslip_velocity) self;
    int k, status;
    ANY(limits);
    ANY(vehicle);
    ANY(self);
    status = OF(noslip_velocity_init)(&self, limits, count, any_real());
    if (status < 0) {
        REACHED(velocity_init_refused);
        /*@ assert self.ready == 0; */
        return;
    }
    REACHED(velocity_init_good);
    /*@ assert status == NOSLIP_OK && self.ready == NOSLIP_READY && self.count == count; */
    for (k = 0; k < count; k++) {
        /*@ assert \is_finite(self.limits[k].speed) && self.limits[k].speed > 0 && self.command[k] == 0; */
    }
    if (OF(noslip_velocity_set_vehicle)(&self, &vehicle) >= 0) {
        REACHED(set_vehicle_good);
        /*@ assert count == 2; */
    }
}

/* A step with arbitrary bits in all that is measured and asked, in commands and limits: it writes the commands only. It is not proved,
 * since it needs relations that intervals do not represent, that these are finite and within their limits: the fuzzers check it. */
void check_velocity_step(int count, int integrates)
{
    OF(noslip_velocity) self;
    REAL asked[NOSLIP_VELOCITIES], nu[NOSLIP_VELOCITIES], command[NOSLIP_VELOCITIES];
    int status;
    ANY(self);
    ANY(asked);
    ANY(nu);
    ANY(command);
    self.count = count;
    status = integrates ? OF(noslip_velocity_step)(&self, asked, nu, any_int, any_real(), command)
                        : OF(noslip_velocity_follow)(&self, asked, nu, any_int, any_real(), command);
    if (status >= 0) {
        REACHED(velocity_good);
    } else {
        REACHED(velocity_refused);
    }
    /*@ assert self.count == count; */
}

void check_watchdog_init(void)
{
    noslip_watchdog_settings settings;
    noslip_watchdog self;
    int status;
    ANY(settings);
    ANY(self);
    status = noslip_watchdog_init(&self, &settings);
    if (status >= 0) {
        REACHED(watchdog_init_good);
        /*@ assert self.ready == NOSLIP_READY && self.state == NOSLIP_WATCHDOG_RUN; */
        /*@ assert self.strikes == 0 && self.good == 0 && self.stood == 0; */
        /*@ assert self.settings.tolerated >= 0 && self.settings.forgiven >= 0 && self.settings.stuck >= 0; */
    } else {
        REACHED(watchdog_init_refused);
        /*@ assert self.ready == 0 && self.state == NOSLIP_WATCHDOG_STOP; */
    }
}

/* Ticks of every kind from a state with so many strikes: they stay within those tolerated, a stop stays one, an error is no run. */
void check_watchdog_step(int tolerated, int forgiven, int strikes, int before)
{
    noslip_watchdog self;
    noslip_watchdog_state state;
    const int status = any_int, ready = any_int ? NOSLIP_READY : 0;
    ANY(self);
    self.settings.tolerated = tolerated;
    self.settings.forgiven = forgiven;
    self.settings.stuck = Frama_C_interval(0, INT32_MAX);
    self.state = before;
    self.strikes = strikes;
    self.good = Frama_C_interval(0, forgiven);
    self.stood = Frama_C_interval(0, INT32_MAX);
    self.ready = ready;
    state = noslip_watchdog_step(&self, status, (uint32_t)any_int, any_int);
    if (state == NOSLIP_WATCHDOG_RUN) {
        REACHED(watchdog_run);
        /*@ assert ready == NOSLIP_READY && status >= 0; */
    } else if (state == NOSLIP_WATCHDOG_HOLD) {
        REACHED(watchdog_hold);
        /*@ assert ready == NOSLIP_READY && status < 0; */
        /*@ assert status == NOSLIP_NONFINITE || status == NOSLIP_RANGE || status == NOSLIP_SINGULAR; */
    } else {
        REACHED(watchdog_stop);
        /*@ assert state == NOSLIP_WATCHDOG_STOP; */
    }
    /*@ assert before == NOSLIP_WATCHDOG_STOP ==> state == NOSLIP_WATCHDOG_STOP; */
    /*@ assert 0 <= self.strikes <= tolerated; */
    /*@ assert self.stood >= 0 && 0 <= self.good <= forgiven; */
    /*@ assert self.settings.tolerated == tolerated && self.settings.forgiven == forgiven; */
}

int main(void)
{
    int strikes, before;
    check_motor_init();
    check_motor_step(NOSLIP_MOTOR_CURRENT, 20, 24, 20);
    check_motor_step(NOSLIP_MOTOR_VOLTAGE, 20, 24, 24);
    check_motor_step(NOSLIP_MOTOR_DUTY, 20, 24, 1);
    check_motor_step(NOSLIP_MOTOR_TORQUE, LARGEST, LARGEST, LARGEST);
    check_motor_limit();
    check_velocity_init(2);
    check_velocity_init(NOSLIP_VELOCITIES);
    check_velocity_step(2, 0);
    check_velocity_step(NOSLIP_VELOCITIES, 1);
    check_watchdog_init();
    for (before = NOSLIP_WATCHDOG_RUN; before <= NOSLIP_WATCHDOG_STOP; before++) {
        check_watchdog_step(0, 0, 0, before);
        for (strikes = 0; strikes <= 3; strikes++) {
            check_watchdog_step(3, 100, strikes, before);
        }
    }
    REACHED(end);
    return 0;
}
