/* Makes one law, steps it once at some state, and prints the answer. The numbers are examples. */
#include <stdio.h>

#include "@{ own(law) }.h"

int main(void)
{
    const @{ own(law ~ "_config") } config = @{ config };
    const @{ own(law ~ "_gains") } gains = @{ gains };
    const @{ own(robot ~ "_state") } state = {@{ state }}; /* yours: from sensors */
    const @{ own(law ~ "_reference") } reference = {0}; /* yours: what the outputs shall do */
    @{ own(robot ~ "_params") } params;
    @{ own(law) } law;
    @{ real } tau[@{ inputs | length }];
    int status = @{ own(robot ~ "_default_params") }(&params);

    if (status == NOSLIP_OK) {
        status = @{ own(law ~ "_init") }(&law, &params, &config, &gains, NULL);
    }
    if (status == NOSLIP_OK) {
        status = @{ own(law ~ "_step") }(&law, &state, &reference@{ dt }, tau);
    }
    if (status < 0) {
        printf("@{ own(law) }: %s\n", noslip_status_name(status));
        return 1;
    }
    printf("@{ own(law) }: %s, @{ names }: @{ printed }\n", noslip_status_name(status), @{ values });
    return 0;
}
