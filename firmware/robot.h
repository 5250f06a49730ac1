/* robot.h - the numbers of this robot and its path. What you change first. */
#ifndef ROBOT_H
#define ROBOT_H

#include "vehicle.h"

#define ROBOT_TOLERANCE 0.02f /* m: so near to the end of the path it has to stop */

/* All settings. NOSLIP_NULL where there is no place for them. */
int robot_settings(vehicle_settings *settings);

#endif
