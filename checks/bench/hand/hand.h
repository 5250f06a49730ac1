/*
 * hand.h - the feedback laws of the LABMATE as a person writes them for speed: the bar that generated code is measured by.
 *
 * Derived on paper, in the body's frame with forward speed v and yaw rate omega. Every law exists for double and, with
 * the suffix _f, for float. No guards at all: the caller keeps away from the singular set.
 *
 * With e the unit vector of the heading, e' the one to its left, l = L + d, w = l omega, P_l moves with v e + w e' and
 * accelerates with f e + g e', where f = v-dot - l omega^2 and g = l omega-dot + v omega. The robot answers with
 *     tau_r + tau_l = r (m_t v-dot - m_c d omega^2)        m_t = m_c + 2 m_w + 2 I_w / r^2
 *     tau_r - tau_l = r/b (J omega-dot + m_c d v omega)    J = I_c + m_c d^2 + 2 m_w b^2 + 2 I_m + 2 I_w b^2 / r^2
 * so that, with p = nu_r + nu_l and q = nu_r - nu_l,
 *     (tau_r + tau_l) / 2 = from_f f + from_qq q^2    (tau_r - tau_l) / 2 = from_g g + from_vq v q
 */
#ifndef HAND_H
#define HAND_H

#include "noslip_real.h"
#include "noslip_trig.h"

#define REAL double
#define NAME(name) name
#include "labmate_type_i.h"
#include "labmate_type_iv_circle.h"
#include "labmate_type_iv_ellipse.h"
#include "labmate_type_iv_line.h"
#include "hand.inc"
#undef REAL
#undef NAME

#define REAL float
#define NAME(name) name##_f
#include "labmate_type_i_f.h"
#include "labmate_type_iv_circle_f.h"
#include "labmate_type_iv_ellipse_f.h"
#include "labmate_type_iv_line_f.h"
#include "hand.inc"
#undef REAL
#undef NAME

#endif
