/* pil.c - see pil.h. */
#include "pil.h"

static int hello(pil *self)
{
    const pil_input *in = &self->input;
    const pil_output *out = &self->output;
    const pil_hello hello_answer = {
#ifdef PIL_LAW
        .params = sizeof in->law.params,
        .config = sizeof in->law.config,
        .gains = sizeof in->law.gains,
        .options = sizeof in->law.options,
        .state = sizeof in->step.state,
        .reference = sizeof in->step.reference,
        .evaluation = sizeof out->evaluation,
        .inputs = sizeof out->step.tau,
        .laws = PIL_LAWS,
#endif
#ifdef PIL_DYNAMICS
        .dynamics = PIL_DYNAMICS_COUNT,
#endif
#ifdef PIL_FEEDBACK
        .feedbacks = PIL_FEEDBACKS,
#endif
        .segment = sizeof in->segment.segment,
        .path_options = sizeof in->path.options,
        .guide = sizeof out->guide,
        .odometry_options = sizeof in->odometry.options,
        .paths = PIL_PATHS,
        .odometries = PIL_ODOMETRIES,
        .integrals = PIL_INTEGRALS,
        .approaches = PIL_APPROACHES,
        .slips = PIL_SLIPS,
        .segments = PIL_SEGMENTS,
        .velocities = PIL_VELOCITIES,
        .disturbances = PIL_DISTURBANCES,
    };
    self->output.hello = hello_answer;
    return NOSLIP_OK;
}

/* -- the law ----------------------------------------------------------------------------------------------------------- */

#ifdef PIL_LAW
static int law_init(pil *self)
{
    return PIL_LAW(_init)(&self->laws[self->request.object], &self->input.law.params, &self->input.law.config,
                          &self->input.law.gains, &self->input.law.options);
}

#if PIL_EXTENSION
static void set_extension(PIL_LAW() *law, const float extension[PIL_EXTENSION])
{
    int i;
    for (i = 0; i < PIL_EXTENSION; i++) {
        law->extension[i] = extension[i];
    }
}
#endif

static int law_step(pil *self)
{
    PIL_LAW() *law = &self->laws[self->request.object];
#if PIL_EXTENSION
    int status, i;
    set_extension(law, self->input.step.extension);
    status = PIL_LAW(_step)(law, &self->input.step.state, &self->input.step.reference, self->input.step.dt,
                            self->output.step.tau);
    for (i = 0; i < PIL_EXTENSION; i++) {
        self->output.step.extension_rate[i] = law->extension_rate[i];
    }
    return status;
#else
    const int status = PIL_LAW(_step)(law, &self->input.step.state, &self->input.step.reference, self->output.step.tau);
#if PIL_GRIP
    self->output.step.believed = law->earned.mu;
#endif
    return status;
#endif
}

static int law_evaluate(pil *self)
{
    PIL_LAW() *law = &self->laws[self->request.object];
#if PIL_EXTENSION
    set_extension(law, self->input.evaluate.extension);
#endif
    return PIL_LAW(_evaluate)(law, &self->input.evaluate.state, &self->input.evaluate.reference, &self->output.evaluation);
}

static int law_friction(pil *self)
{
#if PIL_GRIP
    noslip_believe_at_most_f(&self->laws[self->request.object].earned, &self->laws[self->request.object].grip,
                               self->input.friction);
    return NOSLIP_OK;
#else
    (void)self;
    return NOSLIP_BAD_PARAMETER;
#endif
}
#endif

/* -- the path ---------------------------------------------------------------------------------------------------------- */

static int path_segment(pil *self)
{
    const uint32_t index = self->input.segment.index;
    if (index >= PIL_SEGMENTS) {
        self->answer.fault = PIL_FAULT_OBJECT;
        return NOSLIP_BAD_PARAMETER;
    }
    self->segments[self->request.object][index] = self->input.segment.segment;
    return NOSLIP_OK;
}

static int path_init(pil *self)
{
    const uint32_t k = self->request.object;
    const int32_t count = self->input.path.count;
    if (count > PIL_SEGMENTS) {
        self->answer.fault = PIL_FAULT_OBJECT;
        return NOSLIP_BAD_PARAMETER;
    }
    return noslip_path_init_f(&self->paths[k], self->segments[k], count, &self->input.path.options, &self->output.fault);
}

static int path_look(pil *self)
{
    return noslip_path_look_f(&self->paths[self->request.object], self->input.seen.x, self->input.seen.y,
                              self->input.seen.heading, self->input.seen.forward_speed, &self->output.guide);
}

static int path_update(pil *self)
{
    return noslip_path_update_f(&self->paths[self->request.object], self->input.seen.x, self->input.seen.y,
                                self->input.seen.heading, self->input.seen.forward_speed, &self->output.guide);
}

/* -- dead reckoning, integral action, disturbance observers ----------------------------------------------------------- */

static int odometry_init(pil *self)
{
    return noslip_odometry_init_f(&self->odometries[self->request.object], &self->input.odometry.options,
                                  &self->input.odometry.start);
}

static int odometry_pose(pil *self)
{
    return noslip_odometry_pose_f(&self->odometries[self->request.object], &self->output.pose);
}

static int odometry_move(pil *self)
{
    return noslip_odometry_move_f(&self->odometries[self->request.object], self->input.move.angle, self->input.move.dt,
                                  &self->output.pose);
}

static int odometry_correct(pil *self)
{
    return noslip_odometry_correct_f(&self->odometries[self->request.object], &self->input.correction.truth,
                                     self->input.correction.mode);
}

static int odometry_unwind(pil *self)
{
    return noslip_odometry_unwind_f(&self->odometries[self->request.object]);
}

static int integral_init(pil *self)
{
    return noslip_integral_init_f(&self->integrals[self->request.object], self->input.integral.ki,
                                  self->input.integral.limit);
}

static int integral_step(pil *self)
{
    noslip_integral_f *integral = &self->integrals[self->request.object];
    const int status = noslip_integral_step_f(integral, self->input.sample.error, self->input.sample.dt,
                                              self->input.sample.status, &self->output.integral.add);
    self->output.integral.z = integral->z;
    return status;
}

static int disturbance_init(pil *self)
{
    return noslip_disturbance_init_f(&self->disturbances[self->request.object], self->input.disturbance.rate,
                                     self->input.disturbance.limit);
}

static int disturbance_step(pil *self)
{
    return noslip_disturbance_step_f(&self->disturbances[self->request.object], self->input.observed.measured,
                                     self->input.observed.v, self->input.observed.dt, self->input.observed.status,
                                     &self->output.added);
}

/* -- the approach of a path -------------------------------------------------------------------------------------------- */

static int approach_init(pil *self)
{
    return noslip_approach_init_f(&self->approaches[self->request.object], self->input.approach.acceleration,
                                  self->input.approach.settling, self->input.approach.jerk);
}

static int approach_start(pil *self)
{
    return noslip_approach_start_f(&self->approaches[self->request.object], self->input.approach_start.distance,
                                   self->input.approach_start.distance_rate, self->input.approach_start.speed);
}

static int approach_step(pil *self)
{
    return noslip_approach_step_f(&self->approaches[self->request.object], self->input.approach_step.dt,
                                  self->input.approach_step.speed, &self->output.approached);
}

static int approach_within(pil *self)
{
    return noslip_approach_within_f(&self->approaches[self->request.object], self->input.approach_within.speed,
                                    self->input.approach_within.speed_rate, &self->output.approached);
}

/* -- the speed profile of a path --------------------------------------------------------------------------------------- */

static int profile_init(pil *self)
{
    const uint32_t k = self->request.object;
    const int32_t count = self->input.profile.count;
    if (count > PIL_SEGMENTS) {
        self->answer.fault = PIL_FAULT_OBJECT;
        return NOSLIP_BAD_PARAMETER;
    }
    return noslip_profile_init_f(&self->profiles[k], self->segments[k], count, &self->input.profile.options,
                                 &self->input.profile.limits, self->squares[k]);
}

static int profile_speed(pil *self)
{
    return noslip_profile_speed_f(&self->profiles[self->request.object], &self->input.profile_speed.guide,
                                  self->input.profile_speed.forward_speed, &self->output.profile.speed,
                                  &self->output.profile.speed_rate);
}

/* -- noticing slip ----------------------------------------------------------------------------------------------------- */

static int slip_init(pil *self)
{
    return noslip_slip_init_f(&self->slips[self->request.object], &self->input.slip.options, &self->input.slip.vehicle);
}

static int slip_step(pil *self)
{
    return noslip_slip_step_f(&self->slips[self->request.object], &self->input.slip_step.reading, self->input.slip_step.dt,
                              &self->output.noticed);
}

static int slip_trust(pil *self)
{
    return noslip_slip_trust_f(&self->slips[self->request.object]);
}

/* -- velocity drives --------------------------------------------------------------------------------------------------- */

static int velocity_init(pil *self)
{
    return noslip_velocity_init_f(&self->velocities[self->request.object], self->input.velocity.limits,
                                  self->input.velocity.count, self->input.velocity.period);
}

static int velocity_set_vehicle(pil *self)
{
    return noslip_velocity_set_vehicle_f(&self->velocities[self->request.object], &self->input.vehicle);
}

static int velocity_reset(pil *self)
{
    return noslip_velocity_reset_f(&self->velocities[self->request.object], self->input.nu);
}

static void no_command(pil *self)
{
    int i;
    for (i = 0; i < NOSLIP_VELOCITIES; i++) { /* those beyond the robot's are not written */
        self->output.command[i] = 0;
    }
}

static int velocity_step(pil *self)
{
    no_command(self);
    return noslip_velocity_step_f(&self->velocities[self->request.object], self->input.drive.from, self->input.drive.nu,
                                  self->input.drive.status, self->input.drive.dt, self->output.command);
}

static int velocity_follow(pil *self)
{
    no_command(self);
    return noslip_velocity_follow_f(&self->velocities[self->request.object], self->input.drive.from, self->input.drive.nu,
                                    self->input.drive.status, self->input.drive.dt, self->output.command);
}

#ifdef PIL_DYNAMICS
static int dynamics_init(pil *self)
{
    return PIL_DYNAMICS(_init)(&self->dynamics[self->request.object], &self->input.params);
}

static int dynamics_acceleration(pil *self)
{
    return PIL_DYNAMICS(_acceleration)(&self->dynamics[self->request.object], &self->input.moved.state,
                                       self->input.moved.tau, self->output.acceleration.qdot,
                                       self->output.acceleration.nudot);
}
#endif

#ifdef PIL_FEEDBACK
static int feedback_init(pil *self)
{
    return PIL_FEEDBACK(_init)(&self->feedbacks[self->request.object]);
}

static int feedback_step(pil *self)
{
    return noslip_balance_step_f(&self->feedbacks[self->request.object], self->input.balance.state, self->input.balance.desired,
                                 self->output.tau);
}
#endif

/* -- calls ------------------------------------------------------------------------------------------------------------- */

typedef struct {
    int (*call)(pil *self);
    uint32_t takes, gives, objects;
} operation;

#define TAKES(part) sizeof(((pil_input *)0)->part)
#define GIVES(part) sizeof(((pil_output *)0)->part)

static const operation operations[PIL_OPERATIONS] = {
    [PIL_OP_HELLO] = {hello, 0, GIVES(hello), 1},
#ifdef PIL_LAW
    [PIL_OP_LAW_INIT] = {law_init, TAKES(law), 0, PIL_LAWS},
    [PIL_OP_LAW_STEP] = {law_step, TAKES(step), GIVES(step), PIL_LAWS},
    [PIL_OP_LAW_EVALUATE] = {law_evaluate, TAKES(evaluate), GIVES(evaluation), PIL_LAWS},
    [PIL_OP_LAW_FRICTION] = {law_friction, TAKES(friction), 0, PIL_LAWS},
#endif
    [PIL_OP_PATH_SEGMENT] = {path_segment, TAKES(segment), 0, PIL_PATHS},
    [PIL_OP_PATH_INIT] = {path_init, TAKES(path), GIVES(fault), PIL_PATHS},
    [PIL_OP_PATH_LOOK] = {path_look, TAKES(seen), GIVES(guide), PIL_PATHS},
    [PIL_OP_PATH_UPDATE] = {path_update, TAKES(seen), GIVES(guide), PIL_PATHS},
    [PIL_OP_ODOMETRY_INIT] = {odometry_init, TAKES(odometry), 0, PIL_ODOMETRIES},
    [PIL_OP_ODOMETRY_POSE] = {odometry_pose, 0, GIVES(pose), PIL_ODOMETRIES},
    [PIL_OP_ODOMETRY_MOVE] = {odometry_move, TAKES(move), GIVES(pose), PIL_ODOMETRIES},
    [PIL_OP_ODOMETRY_CORRECT] = {odometry_correct, TAKES(correction), 0, PIL_ODOMETRIES},
    [PIL_OP_INTEGRAL_INIT] = {integral_init, TAKES(integral), 0, PIL_INTEGRALS},
    [PIL_OP_INTEGRAL_STEP] = {integral_step, TAKES(sample), GIVES(integral), PIL_INTEGRALS},
    [PIL_OP_ODOMETRY_UNWIND] = {odometry_unwind, 0, 0, PIL_ODOMETRIES},
    [PIL_OP_APPROACH_INIT] = {approach_init, TAKES(approach), 0, PIL_APPROACHES},
    [PIL_OP_APPROACH_START] = {approach_start, TAKES(approach_start), 0, PIL_APPROACHES},
    [PIL_OP_APPROACH_STEP] = {approach_step, TAKES(approach_step), GIVES(approached), PIL_APPROACHES},
    [PIL_OP_APPROACH_WITHIN] = {approach_within, TAKES(approach_within), GIVES(approached), PIL_APPROACHES},
    [PIL_OP_PROFILE_INIT] = {profile_init, TAKES(profile), 0, PIL_PATHS},
    [PIL_OP_PROFILE_SPEED] = {profile_speed, TAKES(profile_speed), GIVES(profile), PIL_PATHS},
    [PIL_OP_SLIP_INIT] = {slip_init, TAKES(slip), 0, PIL_SLIPS},
    [PIL_OP_SLIP_STEP] = {slip_step, TAKES(slip_step), GIVES(noticed), PIL_SLIPS},
    [PIL_OP_SLIP_TRUST] = {slip_trust, 0, 0, PIL_SLIPS},
    [PIL_OP_VELOCITY_INIT] = {velocity_init, TAKES(velocity), 0, PIL_VELOCITIES},
    [PIL_OP_VELOCITY_SET_VEHICLE] = {velocity_set_vehicle, TAKES(vehicle), 0, PIL_VELOCITIES},
    [PIL_OP_VELOCITY_RESET] = {velocity_reset, TAKES(nu), 0, PIL_VELOCITIES},
    [PIL_OP_VELOCITY_STEP] = {velocity_step, TAKES(drive), GIVES(command), PIL_VELOCITIES},
    [PIL_OP_VELOCITY_FOLLOW] = {velocity_follow, TAKES(drive), GIVES(command), PIL_VELOCITIES},
    [PIL_OP_DISTURBANCE_INIT] = {disturbance_init, TAKES(disturbance), 0, PIL_DISTURBANCES},
    [PIL_OP_DISTURBANCE_STEP] = {disturbance_step, TAKES(observed), GIVES(added), PIL_DISTURBANCES},
#ifdef PIL_DYNAMICS
    [PIL_OP_DYNAMICS_INIT] = {dynamics_init, TAKES(params), 0, PIL_DYNAMICS_COUNT},
    [PIL_OP_DYNAMICS_ACCELERATION] = {dynamics_acceleration, TAKES(moved), GIVES(acceleration), PIL_DYNAMICS_COUNT},
#endif
#ifdef PIL_FEEDBACK
    [PIL_OP_FEEDBACK_INIT] = {feedback_init, 0, 0, PIL_FEEDBACKS},
    [PIL_OP_FEEDBACK_STEP] = {feedback_step, TAKES(balance), GIVES(tau), PIL_FEEDBACKS},
#endif
};

static uint32_t fault_of(const pil_request *request)
{
    if (request->magic != PIL_MAGIC || request->version != PIL_VERSION) {
        return PIL_FAULT_MAGIC;
    }
    if (request->operation >= PIL_OPERATIONS) {
        return PIL_FAULT_OPERATION;
    }
    if (request->size != operations[request->operation].takes) {
        return PIL_FAULT_SIZE;
    }
    return request->object < operations[request->operation].objects ? PIL_FAULT_NONE : PIL_FAULT_OBJECT;
}

uint32_t pil_check(pil *self)
{
    const pil_answer nothing = {PIL_MAGIC, PIL_VERSION, 0, NOSLIP_BAD_PARAMETER, 0};
    self->answer = nothing;
    self->answer.fault = fault_of(&self->request);
    return self->answer.fault;
}

void pil_call(pil *self)
{
    const operation *requested = &operations[self->request.operation];
    self->answer.status = requested->call(self);
    if (self->answer.fault == PIL_FAULT_NONE) {
        self->answer.size = requested->gives;
    }
}
