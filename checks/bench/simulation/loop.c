/* The LABMATE in closed loop with the generated Type I law, along a straight line, by fixed steps of Runge-Kutta 4. */
#include "labmate_type_i.h"

/* x-dot of (11) in forward speed and yaw rate; everything the parameters give is made once. */
typedef struct {
    labmate_type_i law;
    double to_v, to_omega, d, per_m, per_J, m_c_d, start[2], rate[2];
} closed_loop;

int closed_loop_init(closed_loop *self, const labmate_params *a, const labmate_type_i_config *config,
                     const labmate_type_i_gains *gains, const double start[2], const double rate[2])
{
    const double I = a->I_w / (a->r * a->r), bb = a->b * a->b;
    self->to_v = a->r / 2;
    self->to_omega = a->r / (2 * a->b);
    self->d = a->d;
    self->per_m = 1 / (a->r * a->r * (a->m_c + 2 * a->m_w + 2 * I));
    self->per_J = bb / (a->r * a->r * (a->I_c + a->m_c * a->d * a->d + 2 * (a->m_w * bb + a->I_m + I * bb)));
    self->m_c_d = a->m_c * a->d * a->r;
    self->start[0] = start[0];
    self->start[1] = start[1];
    self->rate[0] = rate[0];
    self->rate[1] = rate[1];
    return labmate_type_i_init(&self->law, a, config, gains, NULL);
}

int closed_loop_size(void)
{
    return (int)sizeof(closed_loop);
}

/* dx = x-dot at time t with the law's torques. Answers the law's status. */
int closed_loop_rate(closed_loop *self, double t, const double x[7], double dx[7])
{
    const labmate_type_i_reference wanted = {.x_l = self->start[0] + self->rate[0] * t, .x_l_rate = self->rate[0],
                                             .y_l = self->start[1] + self->rate[1] * t, .y_l_rate = self->rate[1]};
    const labmate_state state = {x[0], x[1], x[2], x[3], x[4], x[5], x[6]};
    const double v = self->to_v * (x[5] + x[6]), omega = self->to_omega * (x[5] - x[6]), side = self->d * omega;
    double s, c, tau[2] = {0, 0}, sum, difference;
    const int status = labmate_type_i_step(&self->law, &state, &wanted, tau);
    noslip_sincos(x[2], &s, &c);
    sum = self->per_m * (tau[0] + tau[1] + self->m_c_d * omega * omega);
    difference = self->per_J * (tau[0] - tau[1] - self->m_c_d * self->to_omega / self->to_v * v * omega);
    dx[0] = v * c - side * s;
    dx[1] = v * s + side * c;
    dx[2] = omega;
    dx[3] = x[5];
    dx[4] = x[6];
    dx[5] = sum + difference;
    dx[6] = sum - difference;
    return status;
}

/* Steps x from 0 to `duration`. Answers the first error's status. */
int closed_loop_run(closed_loop *self, double duration, int steps, double x[7])
{
    const double h = duration / steps;
    double k[4][7], at[7];
    int n, i, stage, status;
    for (n = 0; n < steps; n++) {
        for (stage = 0; stage < 4; stage++) {
            const double ahead = stage == 0 ? 0 : stage == 3 ? h : h / 2;
            for (i = 0; i < 7; i++) {
                at[i] = stage == 0 ? x[i] : x[i] + ahead * k[stage - 1][i];
            }
            status = closed_loop_rate(self, n * h + ahead, at, k[stage]);
            if (status < 0) {
                return status;
            }
        }
        for (i = 0; i < 7; i++) {
            x[i] += h / 6 * (k[0][i] + 2 * (k[1][i] + k[2][i]) + k[3][i]);
        }
    }
    return 0;
}
