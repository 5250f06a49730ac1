{% macro n(name) %}@{ own("noslip_" ~ name) }{% endmacro %}
{% set self = own(robot ~ "_adaptation") %}
{% set dynamics = own(robot ~ "_dynamics") %}
{% set state_type = own(robot ~ "_state") %}
{% set rows = rates | length %}
{% set count = adapted | length %}
/*
 * @{ self }.c - parameters of @{ robot } that change, learned while it drives, @{ real }
{% for line in banner %}
 * @{ line }
{% endfor %}
 */
#define NOSLIP_OWN
#include "@{ self }.h"

int @{ own(robot ~ "_adaptation_init") }(@{ self } *self, const @{ own(robot ~ "_adaptation_config") } *config)
{
    @{ own(robot ~ "_params") } bound;
    @{ real } start[@{ count }];
    int i, status;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->core.ready = 0;
    if (config == NULL) {
        return NOSLIP_NULL;
    }
    status = @{ own(robot ~ "_check_params") }(&config->params);
    if (status != NOSLIP_OK) {
        return status;
    }
{% for q in adapted %}
    self->bounds[@{ loop.index0 }][0] = config->@{ q.in_c }_least;
    self->bounds[@{ loop.index0 }][1] = config->@{ q.in_c }_most;
    start[@{ loop.index0 }] = config->params.@{ q.in_c };
{% endfor %}
    for (i = 0; i < @{ count }; i++) {
        if (!(self->bounds[i][0] < self->bounds[i][1])) {
            return NOSLIP_BAD_PARAMETER;
        }
        start[i] = (start[i] - self->bounds[i][0]) / (self->bounds[i][1] - self->bounds[i][0]);
    }
    status = @{ n("adaptation_init") }(&self->core, &config->options, start, @{ count }, @{ rows });
    if (status != NOSLIP_OK) {
        return status;
    }
    self->core.ready = 0;
    noslip_copy(&bound, &config->params, sizeof bound);
{% for q in adapted %}
    bound.@{ q.in_c } = self->bounds[@{ loop.index0 }][0];
{% endfor %}
    status = @{ own(robot ~ "_dynamics_init") }(&self->least, &bound);
{% for q in adapted %}
    if (status == NOSLIP_OK) {
        bound.@{ q.in_c } = self->bounds[@{ loop.index0 }][1];
        status = @{ own(robot ~ "_dynamics_init") }(&self->most[@{ loop.index0 }], &bound);
        bound.@{ q.in_c } = self->bounds[@{ loop.index0 }][0];
    }
{% endfor %}
    if (status != NOSLIP_OK) {
        return status;
    }
    noslip_copy(&self->params, &config->params, sizeof self->params);
    self->started = 0;
    self->core.ready = NOSLIP_READY;
    return NOSLIP_OK;
}

/* Computes S'MS nudot + bias - S'E tau (10). */
static int @{ own(robot ~ "_adaptation_residual") }(const @{ dynamics } *with, const @{ state_type } *state, const @{ real } *nudot, const @{ real } *tau, @{ real } residual[@{ rows }])
{
    @{ own(robot ~ "_dynamics_evaluation") } all;
    const int status = @{ own(robot ~ "_dynamics_evaluate") }(with, state, &all);
    int i, j;
    if (status != NOSLIP_OK) {
        return status;
    }
    for (i = 0; i < @{ rows }; i++) {
        residual[i] = all.bias[i];
        for (j = 0; j < @{ rows }; j++) {
            residual[i] += all.Mbar[i][j] * nudot[j];
        }
        for (j = 0; j < @{ inputs | length }; j++) {
            residual[i] -= all.input_map[i][j] * tau[j];
        }
    }
    return NOSLIP_OK;
}

/* Learns from the motion between two states. */
static int @{ own(robot ~ "_adaptation_learn") }(@{ self } *self, const @{ state_type } *state, const @{ real } *tau, @{ real } dt)
{
    const @{ state_type } *last = &self->last;
    @{ state_type } middle;
    @{ real } nudot[@{ rows }], regressor[@{ rows * count }], target[@{ rows }], residual[@{ rows }];
    int i, k, status;
{% for member in state %}
    middle.@{ member } = (last->@{ member } + state->@{ member }) / 2;
{% endfor %}
{% for member in rates %}
    nudot[@{ loop.index0 }] = (state->@{ member } - last->@{ member }) / dt;
{% endfor %}
    status = @{ own(robot ~ "_adaptation_residual") }(&self->least, &middle, nudot, tau, target);
    for (k = 0; status == NOSLIP_OK && k < @{ count }; k++) {
        status = @{ own(robot ~ "_adaptation_residual") }(&self->most[k], &middle, nudot, tau, residual);
        for (i = 0; status == NOSLIP_OK && i < @{ rows }; i++) {
            regressor[i * @{ count } + k] = residual[i] - target[i]; /* affine: of the whole distance of the bounds */
        }
    }
    for (i = 0; status == NOSLIP_OK && i < @{ rows }; i++) {
        target[i] = -target[i];
    }
    return status == NOSLIP_OK ? @{ n("adaptation_step") }(&self->core, regressor, target, dt) : status;
}

int @{ own(robot ~ "_adaptation_step") }(@{ self } *self, const @{ state_type } *state, const @{ real } *tau, @{ real } dt, @{ own(robot ~ "_params") } *params)
{
    int status = NOSLIP_NULL;
    if (params == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->core.ready != NOSLIP_READY) {
{% for q in parameters %}
        params->@{ q.in_c } = 0;
{% endfor %}
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    if (state != NULL) {
        status = @{ own(robot ~ "_check_state") }(state);
        if (status == NOSLIP_OK && tau != NULL && self->started) {
            status = dt > 0 ? @{ own(robot ~ "_adaptation_learn") }(self, state, tau, dt) : NOSLIP_BAD_PARAMETER;
        }
        if (status == NOSLIP_OK) {
{% for q in adapted %}
            self->params.@{ q.in_c } = @{ n("adaptation_value") }(self->core.used[@{ loop.index0 }], self->bounds[@{ loop.index0 }][0], self->bounds[@{ loop.index0 }][1]);
{% endfor %}
            noslip_copy(&self->last, state, sizeof self->last);
            self->started = 1;
        }
    }
    noslip_copy(params, &self->params, sizeof *params);
    return status;
}
