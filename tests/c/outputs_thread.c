/*
 * outputs_thread.c - two controllers in two threads, and a third thread that reads the inputs of the first one continuously, as a
 * motor task does. It is built with ThreadSanitizer, which slows the steps down and finds memory that the controllers share; the
 * reader is excluded, since its race is intended. Prints the number of values read and of those beyond the limits.
 */
#include <math.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>

#include "labmate_type_iv_segment_f.h"

#define LIMIT 7.0f
#define STEPS 200000

static float tau[2][2];
static int ended;
static long values, strange;

static void *steps(void *given)
{
    const labmate_type_iv_segment_config_f config = {0.25f, 0, 0, 0, 0.25f};
    const labmate_type_iv_segment_gains_f gains = {4, 4, 2};
    const labmate_options_f options = {.limit = {LIMIT, LIMIT}};
    labmate_params_f params;
    labmate_type_iv_segment_f law;
    labmate_state_f state = {0};
    labmate_type_iv_segment_reference_f reference = {0};
    float *inputs = given;
    int k, status = labmate_default_params_f(&params);
    status += labmate_type_iv_segment_init_f(&law, &params, &config, &gains, &options);
    for (k = 0; k < STEPS && status == 0; k++) {
        state.y_c = k % 3 == 0 ? 400.0f : k % 3 == 1 ? 0.01f : NAN;
        state.phi = 0.1f * (float)(k % 7);
        (void)labmate_type_iv_segment_step_f(&law, &state, &reference, inputs);
    }
    __atomic_store_n(&ended, 1, __ATOMIC_RELEASE);
    return status == 0 ? NULL : given;
}

__attribute__((no_sanitize("thread"))) static void *reads(void *given)
{
    volatile const float *inputs = given;
    while (!__atomic_load_n(&ended, __ATOMIC_ACQUIRE)) {
        const float one = inputs[0], other = inputs[1];
        values += 2;
        strange += !(one <= LIMIT && one >= -LIMIT) + !(other <= LIMIT && other >= -LIMIT);
    }
    return NULL;
}

int main(void)
{
    pthread_t threads[3];
    void *refused[2];
    int k;
    pthread_create(&threads[2], NULL, reads, tau[0]);
    for (k = 0; k < 2; k++) {
        pthread_create(&threads[k], NULL, steps, tau[k]);
    }
    for (k = 0; k < 2; k++) {
        pthread_join(threads[k], &refused[k]);
    }
    pthread_join(threads[2], NULL);
    printf("%d %ld\n", values > 1000, strange);
    return refused[0] != NULL || refused[1] != NULL;
}
