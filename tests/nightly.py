"""Which parameters of tests `make test` leaves to `make nightly`: those of long tests that have siblings with the same check.

Of the functions that SOME names, a third of the parameters stays. A pattern is looked for in what comes after `::` in a test's
name. Tests that are long as a whole carry the marker `nightly` where they are defined; others look at the same, or at a smaller
version of it.
"""

import re
from collections.abc import Iterable
from zlib import crc32

NIGHTLY = {
    "test_flatness": (r"last_trailer_has_the_output\[2\]",),
    "test_telemetry": (r"simulated_table_is_its_run\[(payload|line)\]",),
    "test_identification": (r"two_bodies_that_share_an_inertia\[inertias[12]-",),
    "test_smooth": (r"spline_forward_and_in_reverse\[0\.0-1\.0\]",),
    "test_vectors": (
        r"^test_another_operation_is_found\[dynamics\]$",
        r"^test_another_operation_is_found\[output\]$",
        r"^test_another_operation_is_found\[limit\]$",
    ),
    "test_threads": (r"^test_a_controller\[casadi\]$",),
    "test_drives": (
        r"^test_a_sweep_runs_what_simulate_runs\[kinematic\]$",
        r"^test_a_sweep_runs_what_simulate_runs\[velocity\]$",
        r"^test_a_sweep_runs_what_simulate_runs\[velocity\+torque, late\]$",
        r"^test_drives_on_a_floor\[kinematic\]$",
        r"^test_drives_on_a_floor\[velocity\]$",
    ),
    "test_outputs": (r"^test_every_number_is_written_once\[-O2\]$",),
    "test_analyse": (
        r"^test_det_is_that_of_the_robots_own_phi\[type_i\]$",
        r"short_det_is_the_long_one\[type_iv_segment\]",
        r"that_of_the_robots_own_phi\[(type_iii?|type_iv_(circle|line_offset|circle_offset))\]",
        r"driving_forward_with_it_ahead\[5\.0-singular\]",
    ),
    "test_battery": (
        r"^test_battery\[labmate type_i_extended\]$",
        r"^test_battery\[labmate type_iv_segment_kinematic\]$",
        r"^test_battery\[labmate type_iv_circle_damped\]$",
        r"test_battery\[labmate type_iv_(circle_damped|segment_kinematic)\]",
        r"test_battery\[(ball_plate ball|knife_edge type_i|geared_arm tip)\]",
        r"test_battery\[((car|slope_platform) type_i|slope_platform type_iv_ellipse|turtlebot3_burger type_iii)\]",
        r"test_battery\[((tricycle|rolling_disk|four_wheel|car) type_iv_circle|mobile_manipulator end_point|geared_arm joints)\]",
        r"test_battery\[(turtlebot3_waffle_pi type_i|pioneer_3dx type_ii|(f1tenth|forklift) type_iv_line)\]",
        r"test_battery\[tractor_trailer:(1 type_ii|4 type_i)\]",
        r"test_battery\[(bus type_iv_circle|castor_platform type_iv_circle)\]",
        r"test_battery\[labmate type_i(v_segment_damped|v_circle_extended|_kinematic)\]",
        r"test_battery\[(knife_edge type_iv_circle|balancer drive)\]",
        r"energy_is_the_work_done\[(bus|mobile_manipulator|four_wheel:0|pioneer_3dx|turtlebot3_burger)\]",
        r"test_battery\[(balancer (wheels|speeds|upright)|sleigh heading|snakeboard shape|roller_racer handlebar)\]",
        r"energy_is_the_work_done\[(tractor_trailer:4|turtlebot3_waffle_pi|f1tenth|forklift|castor_platform)\]",
    ),
    "test_batch": (
        r"^test_samples_are_the_runs_of_simulate\[encoders\]$",
        r"^test_samples_are_the_runs_of_simulate\[route\]$",
        r"^test_friction_is_that_of_simulate\[approach\]$",
        r"are_the_runs_of_simulate\[route\]",
        r"friction_is_that_of_simulate\[approach\]",
        r"friction_is_that_of_simulate\[fastest\]",
        r"are_the_runs_of_simulate\[(fastest|sensed|approached)\]",
        r"are_the_runs_of_simulate\[(circle|float|heading|approach|led point|fastest in float|observed.*)\]",
        r"chunks_and_threads\[circle\]",
    ),
    "test_bits": (r"test_bits\[(cortex-m4f (clang|arm-none-eabi-gcc -O(2 |s\]))|rv32imafc|.* clang -O|.*-mavx2)",),
    "test_calibration": (r"other_robots\[robots/car-", r"values_lie_in_their_intervals\[0\.0004\]"),
    "test_cli": (
        r"leaves_nothing\[os\.mkdir-2-15\]",
        r"leaves_nothing\[(import-(2|40|600)-2|import-(9|150)-15|open-400-15|os.mkdir-2-2|os.rename-1)",
        r"full_disk\[False\]",
    ),
    "test_codegen": (
        r"(keep_the_value_of_laws|steps_are_the_law|is_where_the_law_says)\[type_iv_(circle|ellipse)\]",
        r"the_same_bytes_everywhere\[all\]",
        r"name_of_a_parameter_gives_c\[(k2|t1|options)",
        r"name_of_an_output_gives_c\[(k1|h|reference)-",
    ),
    "test_contact": (
        r"^test_forces_are_affine_in_what_is_wanted\[castor_platform\]$",
        r"(ground_of_a_robot_with_supports|balance_the_moments_of_all_forces)\[(two castors|castor aside)\]",
        r"affine_in_what_is_wanted\[(tractor_trailer[01]|mobile_manipulator|four_wheel|slope_platform|tricycle)\]",
        r"affine_in_what_is_wanted\[(castor_platform|turtlebot3_\w+|pioneer_3dx|f1tenth|forklift)\]",
        r"what_the_equations_of_motion_ask\[tractor_trailer\]",
    ),
    "test_dialects": (
        r"selftest_passes\[gcc -std=gnu11, library -std=gnu11, -O2 -mfma\]",
        r"without_the_pragma_on_arm\[-O2-m7\]",
        r"passes_on_arm\[-std=gnu17 -O3\]",
        r"selftest_passes\[(.*-flto|.*-march=native)\]",
    ),
    "test_distribution": (
        r"^test_places_of_the_trailers\[3\]$",
        r"places_of_the_trailers\[4\]",
        r"test_certificate\[labmate_1\]",
        r"judged_as_they_are_driven\[snakeboard",
        r"constant_and_independent\[labmate_2\]",
    ),
    "test_dynamics": (
        r"the_c_is_the_textbook\[(coupled_6|tractor_trailer:3|turtlebot3_waffle_pi|pioneer_3dx|f1tenth|forklift)-",
        r"the_c_is_the_textbook\[(bus|castor_platform|mecanum)-",
        r"the_c_is_the_textbook\[(car|twins|slope_platform|four_wheel|off_axle|knife_edge)-",
    ),
    "test_ekf": (
        r"is_not_written\[(walk|share)\]",
        r"filter_in_50_digits\[(scales-double|pose-float)\]",
        r"init_refuses\[double\]",
    ),
    "test_evaluate": (
        r"many_random_states\[type_iv_segment\]",
        r"many_random_states\[(type_iii?|type_iv_(line|circle|ellipse))\]",
    ),
    "test_excitation": (r"test_refused\[options0-",),
    "test_engine": (
        r"^test_the_engines_mass_matrix_is_that_of_the_mechanism\[castor_platform\]$",
        r"what_the_ground_does\[tractor_trailer\]",
        r"mass_matrix_is_that_of_the_mechanism\[castor_platform\]",
    ),
    "test_extension": (
        r"that_were_placed\[(car|path)-c\]",
        r"the_c_is_the_model\[type_i_extended\]",
        r"analysis_of_an_extended_law\[(car|find_robot-type_iv)",
        r"that_were_placed\[(train|arm|car-casadi|path-casadi)",
        r"the_c_is_the_model\[type_i_offset",
        r"runs_the_same_loop\[(?!line)",
        r"steady_motion\[train",
        r"follows_a_clothoid\[3\.0-cf",
        r"integral_action_adds_a_pole\[c-",
    ),
    "test_figures": (
        r"^test_every_claim_is_as_expected\[7\]$",
        r"^test_every_claim_is_as_expected\[reversing\]$",
        r"every_claim_\w+\[estimated\]",
        r"every_claim_\w+\[(1|4|5|6|8a|8b|9a|9b|10|11|12|13|14|15|16)\]",
        r"every_claim_\w+\[(waypoints|fastest|rates|ellipse|limits|cusp|rolling|sampled|damping|radius)\]",
        r"every_spec_runs_by_itself\[(figure_1[34]|ellipse)\.toml\]",
        r"ctrl_c_leaves_nothing\[0\.5\]",
    ),
    "test_figures_more": (r"every_claim_can_fail\[(10|11|12|14|15|16|reversing|limits|waypoints|fastest|rates|cusp|rolling)\]",),
    "test_firmware": (
        r"an_image_is_repeated\[rv32imac\]",
        r"image_arrives\[(cortex-m4f-clang|netduinoplus2-gcc|rv32)",
        r"dead_reckoning\[round\]",
        r"exit_codes\[rv32",
    ),
    "test_fmu": (
        r"loop_is_the_simulation\[0\.01\]",
        r"controller_is_the_compiled_law\[ball_plate",
    ),
    "test_follow": (r"step_seen_from_the_path\[rolling_disk", r"\[(four_wheel|labmate-_offset)-"),
    "test_follower": (
        r"another_robot_compiles\[(turtlebot3_burger|car-double|forklift)",
        r"are_those_of_the_parts\[double\]",
    ),
    "test_functions": (
        r"in_a_force\[(acos|sinh|tan|exp|atan2?|tanh|equal|either|both|log|asin|cosh|root|hypot|fabs|fmax|sign of a multiple)\]",
        r"in_outputs\[(atan|fmax|hypot|asin|fabs|exp|tanh|acos|sinh|cosh|tan|root|log)\]",
        r"in_a_path\[(tanh|atan2)\]",
        r"outside_a_domain_is_a_status\[(within.*-float|within (a sign|a maximum|a condition|atan2|not)-)",
        r"outside_a_domain_is_a_status\[(asin|acos|sqrt|power)-",
    ),
    "test_grip": (
        r"rolls_or_says_so\[four_wheel-type_iv_line-cf\]",
        r"init_checks_the_friction\[double\]",
        r"c_is_the_reference\[four_wheel-",
        r"\[(car|mobile_manipulator|tractor_trailer:2)-",
        r"any_bits_\w+\[(labmate|mobile_manipulator|four_wheel-type_iv_line-double)",
        r"rolls_or_says_so\[four_wheel-type_iv_line-c\]",
    ),
    "test_guarantees": (
        r"^test_guarantee\[stack-m4f\]$",
        r"^test_guarantee\[instructions-m4f\]$",
        r"^test_eva_finds_in_drives\[a stop that ends by itself\]$",
        r"^test_eva_finds_in_drives\[a command beyond its limit\]$",
        r"^test_a_law_that_grows_is_found\[sizes\]$",
        r"^test_fuzzing_finds\[an estimate beyond its limit\]$",
        r"test_guarantee\[(sanitizers|clang-tidy)\]",
        r"test_guarantee\[(fuzz|misra|eva|eva-bits|symbols-m4f)\]",
        r"test_eva_finds\[(an angle|a write)",
        r"fuzzing_finds\[(an angle beyond integers|an estimate beyond|a command that changes too fast|a speed that)\]",
    ),
    "test_guidance": (r"judged_as_stated\[(1\.414-[14]|0\.0-5\.0)",),
    "test_headers": (
        r"no_library\[-O2-clang\]",
        r"no_library\[-O2-gcc\]",
        r"no_double\[-O2-gcc\]",
        r"same_bits_on_every_compiler\[walk-double\]",
        r"no_double\[(-O0-gcc|-O2-clang)\]",
        r"no_library\[-O0-gcc\]",
    ),
    "test_identify_motors": (
        r"^test_parameters_that_are_seen_only_together_are_not_answered\[1\.0\]$",
        r"exact_logs_give_exact_numbers\[(current|winding)\]",
    ),
    "test_import": (
        r"robot_file_is_the_urdf\[two_wheels\]",
        r"\[two_trailers\]",
        r"(pinocchio|is_the_urdf)\[arm_on_",
        r"robot_file_is_the_urdf\[(mecanum|trailer|tricycle_driven_at_the_rear)\]",
        r"number_is_found\[b\]",
    ),
    "test_import_kinds": (
        r"kind_is_its_links\[(waffle|tiago|diffbot|linorobot|magni|jackal|p3at)\]",
        r"moved_into_line_and_said\[(toe-(1e-06|0\.0001)|camber-0\.0001)",
        r"of_its_rim\[visual\]",
        r"contradict_sides_are_said\[Wheel",
    ),
    "test_integral": (
        r"figure_9b_goes\[controller-0\.0\]",
        r"nothing_winds_up\[slow-casadi\]",
        r"figure_9b_goes\[(plant-0\.0|controller-0\.01)\]",
        r"goes_on_over_joins\[0\.01\]",
    ),
    "test_logs": (r"other_robots_are_not_refused\[tractor_trailer\]",),
    "test_lanes": (r"lanes_are_steps\[type_iv_ellipse-double",),
    "test_kinematic": (
        r"as_desired\[(?!type_iv_segment-c\]|type_iv_line-cf|type_iii-casadi|type_i_offset-casadi)",
        r"(any_bits_in_finite_out|of_desired_velocities)\[double",
        r"(follow_is_the_reference|accelerations_of_the_vehicle_are_kept)\[float",
        r"limit_is_that_of_the_simulation\[type_iv_line\]",
    ),
    "test_large": (
        r"c_is_the_model\[(arm_[45]|manipulator)-",
        r"(singular_exactly|what_the_outer_loop_asks|reciprocal_condition|what_the_runtime_inverts)\[arm_5(\]|-)",
    ),
    "test_limits": (
        r"the_step_costs_no_more\[type_iv_segment-double\]",
        r"the_step_costs_no_more\[type_iv_(circle|ellipse)",
        r"numbers_of_any_size\[double\]",
    ),
    "test_model": (r"test_law\[(type_iii?|type_iv_(line|circle))\]", r"canonical_keeps_the_value\[3\]"),
    "test_mutated": (r"used_or_refused\[(designed|resumed|forged)\]",),
    "test_names": (r"odd_names_compiles_after_all_headers\[clang\]",),
    "test_odometry": (r"float_keeps_small_steps\[rates[12]\]",),
    "test_outer_design": (r"margins_are_python_controls\[(False|True)-[2-7]\]",),
    "test_outer_loop": (
        r"integral_action_removes_the_offset\[None\]",
        r"integral_action_is_simulates\[0\.0\]",
    ),
    "test_package": (
        r"readme_robot\[(float|.*-all)",
        r"export_builds_as_it_is\[(gcc-selection[03]|clang-selection2)\]",
        r"laps_for_a_day\[-1\]",
        r"path_firmware\[clang\]",
    ),
    "test_packages": (r"functions_of_its_system\[zephyr\]",),
    "test_pil": (
        r"test_loop\[(rv32-fastest|m4f-line)\]",
        r"test_loop\[(rv32-(composite|grip)|m4f-fastest)\]",
        r"test_loop\[(rv32-(line|circle|continuous)|m4f-composite)\]",
        r"interrupt_leaves_nothing\[rv32\]",
        r"target_out_of_order\[printf",
    ),
    "test_planning": (
        r"test_no_fit\[<lambda>-options22",
        r"of_a_function\[(sine|ellipse|spiral|wiggles)-0\.002\]",
        r"through_waypoints\[([1-8]-|0-False)",
        r"full_turn\[(0\.1|20\.0)-reeds_shepp\]",
        r"(degenerate_poses|no_detour_is_shorter)\[reeds_shepp\]",
        r"splines_of_scipy_on_their_knots\[CubicSpline\]",
    ),
    "test_poles": (
        r"where_rank_is_lost\[(generate|export --firmware generic)\]",
        r"no_pole_of_their_own\[(turtlebot3_waffle_pi|f1tenth|forklift)\]",
    ),
    "test_project": (
        r"^test_golden_steps_include_an_error\[generic\]$",
        r"finds_a_wrong_bit\[generic\]",
        r"finds_a_wrong_value\[generic\]",
        r"\[rv32\]",
        r"(runs_the_selftest_where_it_belongs|users_flags_alone|builds_and_passes)\[generic\]",
    ),
    "test_redundancy": (
        r"^test_the_speed_gives_way_within_the_limits_of_four_wheels\[double\]$",
        r"c_is_the_model\[type_iv_circle-",
    ),
    "test_robot_figures": (
        r"^test_claims_hold_and_can_fail\[ball_plate\]$",
        r"^test_claims_hold_and_can_fail\[knife_edge\]$",
        r"claims_hold_and_can_fail\[(mobile_manipulator|slope_platform|rolling_disk|geared_arm)\]",
        r"claims_hold_and_can_fail\[(tractor_trailer|tricycle|turtlebot3_\w+|car|four_wheel|pioneer_3dx|f1tenth|forklift)\]",
        r"claims_hold_and_can_fail\[(bus|castor_platform|mecanum)\]",
    ),
    "test_robots": (
        r"refused_with_the_reason\[.*(stranger|1 output)\]",
        r"analyse_answers_as_json\[(mobile_manipulator|slope_platform|car|tricycle|bus|castor_platform|mecanum)\]",
        r"what_brackets_give\[(rolling_disk|mecanum|car|tricycle|slope_platform|mobile_manipulator|bus|castor_platform)\]",
        r"in_closed_form\[(tricycle|car|bus)",
        r"those_of_kane_and_lagrange\[(mobile_manipulator|slope_platform|tricycle|castor_platform)\]",
        r"\[castor_platform\]",
    ),
    "test_rolling": (
        r"rates_do_to_rigid_bodies\[(ellipsoid on plane|hollow_ellipsoid|cap on saddle|cylinder)",
        r"has_no_spin\[(ellipsoid on plane|hollow_ellipsoid|cap on saddle|cylinder)",
    ),
    "test_rooms": (r"planted_import_is_found\[name1",),
    "test_runtime": (
        r"^test_needs_no_library\[-O2-clang\]$",
        r"float_side_has_no_double\[-O2-clang\]",
    ),
    "test_safety": (
        r"within_what_is_proved\[0\.0\]",
        r"a_course_is_that_of_the_run\[ellipse\]",
    ),
    "test_scene": (
        r"^test_what_does_not_go_with_a_scene\[changes1-is on a slope of its own\]$",
        r"written_is_the_robot\[tractor_trailer:2\]",
    ),
    "test_shape": (r"not_decided_is_not_claimed\[robot[12]\]",),
    "test_structure": (r"law_of_parameters\[(tricycle|car)-",),
    "test_sweep": (
        r"^test_correlated_numbers_keep_their_distributions\[random\]$",
        r"failure_by_default\[II-",
    ),
    "test_slip": (r"in_each_backend\[(cf|casadi)\]",),
    "test_tracking": (
        r"test_same_bits\[double\]",
        r"from_beginning_to_end\[[1-5]\d-",
        r"(double|float)_against_the_reference\[[1-5]\d",
        r"random_input\[double\]",
    ),
    "test_tutorial": (r"robot_of_a_file_in_every_command\[(export1|outer-loop1)\]",),
    "test_verify": (
        r"wrong_generator_writes_nothing\[(generate-optimizer|export-monomials)\]",
        r"wrong_generator_writes_nothing\[generate-(monomials|slope|grip|standstill|foot)\]",
        r"wrong_batch_law_writes_nothing\[fine",
    ),
}

SOME = {
    "test_battery": ("test_energy_is_the_work_done",),
    "test_codegen": (
        "test_conics",
        "test_laws_in_c_compute_what_the_graph_says",
        "test_passes_keep_the_value_of_laws",
        "test_singular_is_where_the_law_says",
        "test_steps_are_the_law",
    ),
    "test_contact": ("test_forces_are_affine_in_what_is_wanted",),
    "test_damped": (
        "test_outside_the_band_every_bit_is_that_of_the_law_without_one",
        "test_starts_at_exactly_the_normal_reach_the_path",
    ),
    "test_distribution": (
        "test_growth_agrees_with_numerical_brackets",
        "test_growth_is_the_known_one",
    ),
    "test_disturbance": ("test_c_is_the_reference",),
    "test_dynamics": ("test_the_c_is_the_textbook",),
    "test_engine": ("test_the_engines_mass_matrix_is_that_of_the_mechanism",),
    "test_flatness": (
        "test_shipped_robots_are_flat_as_in_the_literature",
        "test_the_outputs_along_a_motion_give_the_state",
        "test_unseen_robots_are_flat_as_in_the_literature",
    ),
    "test_integral": ("test_a_sampled_loop_is_the_one_written_out",),
    "test_large": (
        "test_c_is_the_model",
        "test_outputs_do_what_the_outer_loop_asks",
    ),
    "test_limits": (
        "test_c_is_casadi",
        "test_limits_hold",
        "test_slow_by_itself",
        "test_within_limits_nothing_changes",
    ),
    "test_logs": ("test_it_is_found_which_column_is_wrong",),
    "test_outer_design": ("test_structured_singular_value",),
    "test_outer_loop": (
        "test_limit_of_the_period",
        "test_wrong_model_against_nonlinear_runs",
    ),
    "test_planning": ("test_stays_within_the_stated_distance_of_a_function",),
    "test_poles": ("test_shipped_robots_have_no_pole_of_their_own",),
    "test_robots": (
        "test_a_wrong_output_is_refused_where_it_is_written",
        "test_accelerations_are_those_of_kane_and_lagrange",
        "test_the_shipped_run_of_each_robot_comes_to_what_is_wanted",
    ),
    "test_rolling": (
        "test_brackets_of_the_exact_analysis_agree",
        "test_forms_are_their_definitions",
        "test_growth_2_3_5",
    ),
    "test_runtime": ("test_a_header_stands_alone",),
    "test_schema": ("test_shipped_specs_name_their_schema_and_satisfy_it",),
    "test_shape": ("test_the_verdict_is_what_driving_shows",),
    "test_tracking": (
        "test_double_against_the_reference",
        "test_follows_the_path_from_beginning_to_end",
        "test_never_back",
    ),
    "test_tutorial": ("test_a_robot_of_a_file_in_every_command",),
    "test_verdicts": (
        "test_shipped_robots_are_judged_as_in_the_literature",
        "test_unseen_robots_are_judged_as_in_the_literature",
    ),
}  # functions with many similar parameters: of these, a third stays


def is_nightly(file: str, name: str) -> bool:
    """Is a test (its name after `::`) of a file (without `.py`) one of the above?"""
    left_out = name.partition("[")[0] in SOME.get(file, ()) and crc32(name.encode()) % 3 != 0
    return left_out or any(re.search(pattern, name) for pattern in NIGHTLY.get(file, ()))


def faults(tests: Iterable[tuple[str, str]]) -> list[str]:
    """Patterns and names that fit no test, functions of which `make test` has none; `tests`: all (file, name) of some files."""
    tests, found = list(tests), []
    for file in sorted({file for file, _ in tests} & (NIGHTLY.keys() | SOME.keys())):
        names = [name for each, name in tests if each == file]
        functions = {name.partition("[")[0] for name in names}
        found += [f"{file}: no test fits {p}" for p in NIGHTLY.get(file, ()) if not any(re.search(p, name) for name in names)]
        found += [f"{file}: no test fits {name}" for name in SOME.get(file, ()) if name not in functions]
        kept = {name.partition("[")[0] for name in names if not is_nightly(file, name)}
        found += [f"{file}: no {name} is left" for name in sorted(functions - kept)]
    return found
