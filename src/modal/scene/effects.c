/* effects.c - the table of effects: one line each (lowering.h says how to add one)
 *
 * The order is that of the contracts' table: messages list the types in it, and manuals will.
 */
#include "modal/scene/lowering.h"
#include "modal/scene/scene.h"

extern const struct scene_effect_kind effect_spring, effect_damper, effect_cubic_spring,
    effect_polynomial_spring, effect_friction, effect_gap, effect_parametric_stiffness,
    effect_polynomial_damper, effect_coulomb, effect_regularised_coulomb, effect_iwan,
    effect_contact_friction, effect_contact_bed, effect_lua, effect_axial_load,
    effect_viscous_damping, effect_strain_rate_damping, effect_modal_damping,
    effect_rayleigh_damping, effect_bearing, effect_coupling, effect_polynomial_coupling,
    effect_gyroscopic, effect_rotary_inertia, effect_clearance, effect_airloads;

const struct scene_effect_kind *const scene_effects[] = {
    &effect_spring,
    &effect_damper,
    &effect_cubic_spring,
    &effect_polynomial_spring,
    &effect_friction,
    &effect_gap,
    &effect_parametric_stiffness,
    &effect_polynomial_damper,
    &effect_coulomb,
    &effect_regularised_coulomb,
    &effect_iwan,
    &effect_contact_friction,
    &effect_contact_bed,
    &effect_polynomial_coupling,
    &effect_lua,
    &effect_axial_load,
    &effect_viscous_damping,
    &effect_strain_rate_damping,
    &effect_modal_damping,
    &effect_rayleigh_damping,
    &effect_bearing,
    &effect_coupling,
    &effect_gyroscopic,
    &effect_rotary_inertia,
    &effect_clearance,
    &effect_airloads,
    NULL,
};
