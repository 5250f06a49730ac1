/*
 * pil.h - processor in the loop: a law or a state feedback, paths and their speed profiles, approaches, odometry, integral action,
 * disturbance observers, noticing slip and commands of velocity drives on a target, called by a computer that simulates the vehicle.
 *
 * A call is a request and an answer, both of 32-bit words in the byte order of the target, with structs as they are in memory. The
 * objects (laws, paths and so on) stay on the target; a request selects one by its number.
 *
 * The law is the one included by pil_law.h, which defines PIL_ROBOT(name) and PIL_LAW(name), the C names of the robot and the law in
 * float, PIL_GRIP to 1 if the law has the member grip, else 0, and PIL_EXTENSION, the number of states of its dynamic extension.
 * These states are sent with each call and replace those of the law. Unless the law is kinematic, it also defines
 * PIL_DYNAMICS(name), PIL_COORDINATES and PIL_DOF, those of the robot's dynamics.
 *
 * In place of a law it may include the header of a state feedback, and define PIL_FEEDBACK(name), its C name in float, and PIL_STATES
 * and PIL_INPUTS, its sizes. Operations of what an image does not have answer with PIL_FAULT_OBJECT.
 */
#ifndef PIL_H
#define PIL_H

#include "noslip_approach.h"
#include "noslip_disturbance.h"
#include "noslip_integral.h"
#include "noslip_odometry.h"
#include "noslip_path.h"
#include "noslip_profile.h"
#include "noslip_slip.h"
#include "noslip_velocity.h"
#include "pil_law.h"

#define PIL_MAGIC 0x4c49504eu /* "NPIL" in little-endian order */
#define PIL_VERSION 1u

/* Number of objects of each kind, and of segments of a path. */
#define PIL_LAWS 1024
#define PIL_PATHS 16
#define PIL_ODOMETRIES 16
#define PIL_INTEGRALS 64
#define PIL_DISTURBANCES 64
#define PIL_APPROACHES 16
#define PIL_SLIPS 16
#define PIL_VELOCITIES 16
#define PIL_DYNAMICS_COUNT 16
#define PIL_FEEDBACKS 16
#define PIL_SEGMENTS 512

/* Operations: input -> output, in addition to the status returned. */
enum {
    PIL_OP_HELLO,            /* -> pil_hello */
    PIL_OP_LAW_INIT,         /* params, config, gains, options -> */
    PIL_OP_LAW_STEP,         /* state, reference(, dt, extension) -> tau(, extension rate)(, friction believed) */
    PIL_OP_LAW_EVALUATE,     /* state, reference(, extension) -> evaluation */
    PIL_OP_PATH_SEGMENT,     /* index, segment -> */
    PIL_OP_PATH_INIT,        /* count, options -> fault */
    PIL_OP_PATH_LOOK,        /* x, y, heading, forward speed -> guide */
    PIL_OP_PATH_UPDATE,      /* x, y, heading, forward speed -> guide */
    PIL_OP_ODOMETRY_INIT,    /* options, start -> */
    PIL_OP_ODOMETRY_POSE,    /* -> pose */
    PIL_OP_ODOMETRY_MOVE,    /* angle[2], dt -> pose */
    PIL_OP_ODOMETRY_CORRECT, /* truth, mode -> */
    PIL_OP_INTEGRAL_INIT,    /* ki, limit -> */
    PIL_OP_INTEGRAL_STEP,    /* error, dt, status -> ki z, z */
    PIL_OP_ODOMETRY_UNWIND,  /* -> */
    PIL_OP_APPROACH_INIT,    /* acceleration, settling, jerk -> */
    PIL_OP_APPROACH_START,   /* distance, distance rate, speed -> */
    PIL_OP_APPROACH_STEP,    /* dt, speed -> approached */
    PIL_OP_APPROACH_WITHIN,  /* speed, speed rate -> approached */
    PIL_OP_PROFILE_INIT,     /* count, options, limits ->; of the path with the same number, whose segments it has */
    PIL_OP_PROFILE_SPEED,    /* guide, forward speed -> speed, its rate */
    PIL_OP_SLIP_INIT,        /* options, vehicle -> */
    PIL_OP_SLIP_STEP,        /* reading, dt -> noticed */
    PIL_OP_SLIP_TRUST,       /* -> */
    PIL_OP_LAW_FRICTION,     /* friction -> */
    PIL_OP_VELOCITY_INIT,    /* limits[NOSLIP_VELOCITIES], count, period -> */
    PIL_OP_VELOCITY_SET_VEHICLE, /* vehicle -> */
    PIL_OP_VELOCITY_RESET,   /* nu -> */
    PIL_OP_VELOCITY_STEP,    /* u, nu, status, dt -> command */
    PIL_OP_VELOCITY_FOLLOW,  /* desired, nu, status, dt -> command */
    PIL_OP_DYNAMICS_INIT,    /* params -> */
    PIL_OP_DYNAMICS_ACCELERATION, /* state, tau -> qdot, nudot */
    PIL_OP_DISTURBANCE_INIT, /* rate, limit -> */
    PIL_OP_DISTURBANCE_STEP, /* measured, v, dt, status -> minus the estimate */
    PIL_OP_FEEDBACK_INIT,    /* -> */
    PIL_OP_FEEDBACK_STEP,    /* state, desired -> tau */
    PIL_OPERATIONS
};

/* Faults of a request. Nothing is called then, and the program ends after the answer. */
enum {
    PIL_FAULT_NONE,
    PIL_FAULT_MAGIC,     /* it does not begin with PIL_MAGIC and PIL_VERSION */
    PIL_FAULT_OPERATION, /* unknown operation */
    PIL_FAULT_SIZE,      /* wrong number of bytes for the operation */
    PIL_FAULT_OBJECT     /* no object or segment with this number */
};

typedef struct {
    uint32_t magic, version;
    uint32_t operation;
    uint32_t object; /* from 0 */
    uint32_t size;   /* bytes that follow */
} pil_request;

typedef struct {
    uint32_t magic, version;
    uint32_t fault;
    int32_t status; /* of the function called */
    uint32_t size;  /* bytes that follow */
} pil_answer;

/* Sizes of the structs (bytes), to check that both sides use the same ones, and numbers of objects; without a law its sizes are 0. */
typedef struct {
    uint32_t params, config, gains, options, state, reference, evaluation, inputs;
    uint32_t segment, path_options, guide, odometry_options;
    uint32_t laws, paths, odometries, integrals, approaches, slips, segments, velocities, dynamics, disturbances;
    uint32_t feedbacks;
} pil_hello;

typedef union {
#ifdef PIL_LAW
    struct {
        PIL_ROBOT(_params) params;
        PIL_LAW(_config) config;
        PIL_LAW(_gains) gains;
        PIL_ROBOT(_options) options;
    } law;
    struct {
        PIL_ROBOT(_state) state;
        PIL_LAW(_reference) reference;
#if PIL_EXTENSION
        float dt, extension[PIL_EXTENSION];
#endif
    } step;
    struct {
        PIL_ROBOT(_state) state;
        PIL_LAW(_reference) reference;
#if PIL_EXTENSION
        float extension[PIL_EXTENSION];
#endif
    } evaluate;
#endif
    struct {
        uint32_t index;
        noslip_segment_f segment;
    } segment;
    struct {
        int32_t count;
        noslip_path_options_f options;
    } path;
    struct {
        float x, y, heading, forward_speed;
    } seen;
    struct {
        noslip_odometry_options_f options;
        noslip_pose_f start;
    } odometry;
    struct {
        float angle[2], dt;
    } move;
    struct {
        noslip_pose_f truth;
        int32_t mode;
    } correction;
    struct {
        float ki, limit;
    } integral;
    struct {
        float error, dt;
        int32_t status;
    } sample;
    struct {
        float rate, limit;
    } disturbance;
    struct {
        float measured, v, dt;
        int32_t status;
    } observed;
    struct {
        float acceleration, settling, jerk;
    } approach;
    struct {
        float distance, distance_rate, speed;
    } approach_start;
    struct {
        float dt, speed;
    } approach_step;
    struct {
        float speed, speed_rate;
    } approach_within;
    struct {
        int32_t count;
        noslip_path_options_f options;
        noslip_profile_limits_f limits;
    } profile;
    struct {
        noslip_guide_f guide;
        float forward_speed;
    } profile_speed;
    struct {
        noslip_slip_options_f options;
        noslip_odometry_options_f vehicle;
    } slip;
    struct {
        noslip_slip_reading_f reading;
        float dt;
    } slip_step;
    float friction; /* the most that may be believed */
    struct {
        noslip_velocity_limits_f limits[NOSLIP_VELOCITIES];
        int32_t count;
        float period;
    } velocity;
    noslip_velocity_vehicle_f vehicle;
    float nu[NOSLIP_VELOCITIES];
    struct {
        float from[NOSLIP_VELOCITIES], nu[NOSLIP_VELOCITIES];
        int32_t status;
        float dt;
    } drive;
#ifdef PIL_DYNAMICS
    PIL_ROBOT(_params) params;
    struct {
        PIL_ROBOT(_state) state;
        float tau[sizeof((PIL_ROBOT(_options) *)0)->limit / sizeof(float)];
    } moved;
#endif
#ifdef PIL_FEEDBACK
    struct {
        float state[PIL_STATES], desired[PIL_STATES];
    } balance;
#endif
} pil_input;

typedef union {
    pil_hello hello;
#ifdef PIL_LAW
    struct {
        float tau[sizeof((PIL_LAW() *)0)->limit / sizeof(float)];
#if PIL_EXTENSION
        float extension_rate[PIL_EXTENSION];
#endif
#if PIL_GRIP
        float believed;
#endif
    } step;
    PIL_LAW(_evaluation) evaluation;
#endif
    noslip_path_fault_f fault;
    noslip_guide_f guide;
    noslip_pose_f pose;
    noslip_approached_f approached;
    noslip_noticed_f noticed;
    struct {
        float speed, speed_rate;
    } profile;
    struct {
        float add, z;
    } integral;
    float added;
    float command[NOSLIP_VELOCITIES];
#ifdef PIL_DYNAMICS
    struct {
        float qdot[PIL_COORDINATES], nudot[PIL_DOF];
    } acceleration;
#endif
#ifdef PIL_FEEDBACK
    float tau[PIL_INPUTS];
#endif
} pil_output;

/* Complete state. Read `request`; if pil_check accepts it, read its bytes into `input` and call pil_call; then write `answer` and
 * its bytes of `output`. */
typedef struct {
    pil_request request;
    pil_input input;
    pil_answer answer;
    pil_output output;
#ifdef PIL_LAW
    PIL_LAW() laws[PIL_LAWS];
#endif
    noslip_path_f paths[PIL_PATHS];
    noslip_segment_f segments[PIL_PATHS][PIL_SEGMENTS];
    noslip_odometry_f odometries[PIL_ODOMETRIES];
    noslip_integral_f integrals[PIL_INTEGRALS];
    noslip_disturbance_f disturbances[PIL_DISTURBANCES];
    noslip_approach_f approaches[PIL_APPROACHES];
    noslip_profile_f profiles[PIL_PATHS];
    float squares[PIL_PATHS][PIL_SEGMENTS];
    noslip_slip_f slips[PIL_SLIPS];
    noslip_velocity_f velocities[PIL_VELOCITIES];
#ifdef PIL_DYNAMICS
    PIL_DYNAMICS() dynamics[PIL_DYNAMICS_COUNT];
#endif
#ifdef PIL_FEEDBACK
    noslip_balance_f feedbacks[PIL_FEEDBACKS];
#endif
} pil;

/* Checks a request before its input is read and prepares the answer. Returns the fault, or PIL_FAULT_NONE. */
uint32_t pil_check(pil *self);

/* Executes a request that pil_check has accepted. */
void pil_call(pil *self);

#endif
