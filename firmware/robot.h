/* robot.h - config of this robot and its path: change these first. */
#ifndef ROBOT_H
#define ROBOT_H

#include "labmate_telemetry_f.h"

#define ROBOT_SEGMENTS 6      /* of its path */
#define ROBOT_IMAGE LABMATE_FOLLOWER_IMAGE_F(ROBOT_SEGMENTS) /* bytes of its config */
#define ROBOT_TOLERANCE 0.02f /* m: largest allowed distance from the end of the path */

/* Writes the whole config. Returns NOSLIP_NULL for a null pointer. */
int robot_config(labmate_follower_config_f *config);

#endif
