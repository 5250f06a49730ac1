/* robot.h - settings of this robot and its path: change these first. */
#ifndef ROBOT_H
#define ROBOT_H

#include "vehicle.h"

#define ROBOT_TOLERANCE 0.02f /* m: largest allowed distance from the end of the path */

/* Writes all settings. Returns NOSLIP_NULL for a null pointer. */
int robot_settings(vehicle_settings *settings);

#endif
