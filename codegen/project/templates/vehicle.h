{% set config = own(robot ~ "_follower_config") %}
/* vehicle.h - the numbers of this vehicle. */
#ifndef VEHICLE_H
#define VEHICLE_H

#include "@{ own(robot ~ "_follower") }.h"

const @{ config } *vehicle_config(void);

#endif
