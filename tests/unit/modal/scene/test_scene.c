/* Tests as well: airloads.c axial_load.c beam.c effects.c gap.c iwan.c loads.c lowering.c
 * lowering_finish.c matrices.c modal_damping.c polynomial_spring.c program.c rayleigh_damping.c
 * spring.c strain_rate_damping.c structures.c unilateral_contact.c */
#include "check.h"
#include <stdlib.h>
#include "base/json.h"
#include "modal/scene/lowering.h"
#include "modal/scene/scene.h"
#include "scene_text.h"

/* TEXT fails with STATUS at FIELD, and the output is left alone. */
static void refused(const char *text, enum modal_status status, const char *field)
{
    struct modal_error err = { 0 };
    struct program *before = (struct program *)&err, *p = before;
    cJSON *scene = scene_text(text);

    if (scene_lower(scene, NULL, &p, &err) != status)
        fail_msg("%s: not refused as %s", text, modal_status_code(status));
    if (strcmp(err.field, field) != 0)
        fail_msg("%s: refused at %s (%s), not %s", text, err.field, err.message, field);
    CHECK(p == before);
    cJSON_Delete(scene);
}

static double entry(const struct sparse *a, int i, int j)
{
    for (int k = a->start[i]; k < a->start[i + 1]; k++)
        if (a->index[k] == j)
            return a->value[k];
    return 0;
}

#define CHAIN \
    "'structure':{'type':'chain','masses':[2.5,3.5],'springs':[10,20,40],'dampers':[1,2,4]}"

TEST(a_chain_has_the_matrices_of_its_elements)
{
    struct program *p = program_text("{" CHAIN "}");

    CHECK(p->n == 2 && program_class(p) == PROGRAM_LINEAR_CONSTANT && program_states(p) == 4);
    CHECK_STRING(p->dofs[1], "x2");
    CHECK(entry(&p->constant[PROGRAM_M], 1, 1) == 3.5);
    CHECK(entry(&p->constant[PROGRAM_K], 0, 0) == 30 &&
          entry(&p->constant[PROGRAM_K], 0, 1) == -20);
    CHECK(entry(&p->constant[PROGRAM_K], 1, 1) == 60 && entry(&p->constant[PROGRAM_C], 1, 1) == 6);
    program_free(p);
}

TEST(sparse_matrices_lower_to_the_program_of_nested_lists)
{
    struct program *dense = program_text("{'structure':{'type':'matrices','M':[[2,0.5],[0.5,3]],"
                                         "'K':[[5,-1],[-2,7]],'C':[[0.1,0],[0,0.2]]}}");
    struct program *sparse =
        program_text("{'structure':{'type':'matrices','M':{'shape':[2,2],'row_pointers':[0,2,4],"
                     "'columns':[0,1,0,1],'values':[2,0.5,0.5,3]},'K':[[5,-1],[-2,7]],'C':"
                     "{'shape':[2,2],'row_pointers':[0,1,2],'columns':[0,1],'values':[0.1,0.2]}}}");

    CHECK_STRING(sparse->hash, dense->hash);
    program_free(dense);
    program_free(sparse);
}

TEST(gyroscopic_matrices_come_times_the_speed)
{
    struct program *p = program_text("{'structure':{'type':'matrices','M':[[1,0],[0,1]],'K':"
                                     "[[1,0],[0,1]],'G':[[0,3],[-3,0]],'speed':0.5,'dofs':['a',"
                                     "'b']}}");

    CHECK(entry(&p->constant[PROGRAM_C], 0, 1) == 1.5 &&
          entry(&p->constant[PROGRAM_C], 1, 0) == -1.5);
    CHECK_STRING(p->dofs[0], "a");
    program_free(p);
}

/* The pinned-pinned beam's first frequency is (pi/l)^2 sqrt(EI/m); four cubic elements are 2.6e-4
 * high at most. */
TEST(a_beam_resists_a_uniform_curvature_as_the_closed_form)
{
    struct program *p = program_text(
        "{'structure':{'type':'beam','length':1.7,'elements':4,'EI':6570,'mass_per_length':3.24}}");
    double x[8], f = 0;

    CHECK(p->n == 8);
    CHECK_STRING(p->dofs[0], "th0");
    CHECK_STRING(p->dofs[7], "th4");
    /* w = x (l - x) has w'' = -2: the energy is EI 4 l / 2, exact in cubic elements. */
    for (int i = 0, d = 0; i <= 4; i++) {
        double at = 1.7 * i / 4;
        if (i > 0 && i < 4)
            x[d++] = at * (1.7 - at);
        x[d++] = 1.7 - 2 * at;
    }
    for (int i = 0; i < 8; i++)
        for (int j = 0; j < 8; j++)
            f += x[i] * entry(&p->constant[PROGRAM_K], i, j) * x[j];
    CHECK_NEAR(f, 6570 * 4 * 1.7, 1e-11 * 6570 * 4 * 1.7);
    program_free(p);
}

/* P/2 int w'^2 = P l^3 / 6 for w = x (l - x). */
TEST(an_axial_load_is_the_geometric_stiffness_times_minus_its_compression)
{
    static const char *const texts[] = {
        "{'structure':{'type':'beam','length':1.7,'elements':4,'EI':6570,'mass_per_length':3.24},"
        "'omega':9,'effects':[{'type':'axial_load','mean':13}]}",
        "{'structure':{'type':'beam','length':1.7,'elements':4,'EI':6570,'mass_per_length':3.24},"
        "'omega':9,'effects':[{'type':'axial_load','amplitude':13}]}"
    };
    struct program *mean = program_text(texts[0]), *pulse = program_text(texts[1]);
    double x[8], f = 0, g = 0;

    CHECK(program_class(mean) == PROGRAM_LINEAR_CONSTANT &&
          program_class(pulse) == PROGRAM_LINEAR_PERIODIC);
    CHECK(pulse->harmonics == 1 && pulse->harmonic[0].k == 1);
    for (int i = 0, d = 0; i <= 4; i++) {
        double at = 1.7 * i / 4;
        if (i > 0 && i < 4)
            x[d++] = at * (1.7 - at);
        x[d++] = 1.7 - 2 * at;
    }
    for (int i = 0; i < 8; i++)
        for (int j = 0; j < 8; j++) {
            f += x[i] * entry(&mean->constant[PROGRAM_K], i, j) * x[j];
            g += x[i] * entry(&pulse->harmonic[0].cosine[PROGRAM_K], i, j) * x[j];
        }
    CHECK_NEAR(f, 6570 * 4 * 1.7 - 13 * 1.7 * 1.7 * 1.7 / 3, 1e-11 * 6570 * 7);
    CHECK_NEAR(g, -13 * 1.7 * 1.7 * 1.7 / 3, 1e-12 * 22);
    program_free(mean);
    program_free(pulse);
}

TEST(parametric_stiffness_keeps_its_phase)
{
    struct program *p =
        program_text("{" CHAIN ",'omega':2,'effects':[{'type':'parametric_stiffness','dof':'x1','"
                               "to':'x2','stiffness':3,'k':2,'phase':0.3}]}");

    CHECK(p->harmonics == 1 && p->harmonic[0].k == 2);
    CHECK_NEAR(entry(&p->harmonic[0].cosine[PROGRAM_K], 0, 1), -3 * cos(0.3), 1e-15);
    CHECK_NEAR(entry(&p->harmonic[0].sine[PROGRAM_K], 0, 0), -3 * sin(0.3), 1e-15);
    program_free(p);
}

/* Phi^T C Phi of modal damping is diag(2 zeta w): its trace against M^-1 is the sum of 2 zeta_i
 * w_i. */
TEST(modal_damping_gives_the_modes_their_ratios)
{
    struct program *p =
        program_text("{'structure':{'type':'chain','masses':[2,2],'springs':[8,5,8]},'effects':"
                     "[{'type':'modal_damping','ratios':[0.01,0.03]}]}");
    const struct sparse *C = &p->constant[PROGRAM_C];
    double w1 = sqrt(8 / 2.0), w2 = sqrt(18 / 2.0);      /* in phase, out of phase */

    CHECK_NEAR(entry(C, 0, 0) + entry(C, 0, 1), 2 * 2 * 0.01 * w1, 1e-14);
    CHECK_NEAR(entry(C, 0, 0) - entry(C, 0, 1), 2 * 2 * 0.03 * w2, 1e-14);
    program_free(p);
}

TEST(damping_of_the_structure_ignores_the_other_effects)
{
    struct program *p = program_text("{" CHAIN
                                     ",'effects':[{'type':'spring','dof':'x1','stiffness':1000},"
                                     "{'type':'rayleigh_damping','alpha':0.5,'beta':0.25},"
                                     "{'type':'strain_rate_damping','mu':2}]}");

    CHECK_NEAR(entry(&p->constant[PROGRAM_C], 0, 0), 3 + 0.5 * 2.5 + 0.25 * 30 + 2 * 30, 1e-13);
    CHECK_NEAR(entry(&p->constant[PROGRAM_C], 0, 1), -2 - 0.25 * 20 - 2 * 20, 1e-13);
    CHECK(entry(&p->constant[PROGRAM_K], 0, 0) == 1030);
    program_free(p);
}

TEST(local_laws_sit_at_their_dofs_with_their_effects)
{
    struct program *p =
        program_text("{" CHAIN ",'effects':[{'type':'spring','dof':'x1','stiffness':1},{'type':'"
                               "friction','dof':'x2','to':'x1','stiffness':3,'limit':2},"
                               "{'type':'gap','dof':'x1','stiffness':3,'clearance':-0.1},"
                               "{'type':'cubic_spring','dof':'x2','coefficient':0}]}");

    CHECK(p->laws == 2 && program_class(p) == PROGRAM_NONLINEAR && p->effects == 4);
    CHECK(p->law[0].effect == 1 && law_ends(&p->law[0]) == 2 && law_ends(&p->law[1]) == 1);
    CHECK(p->law[0].end[0].dof == 1 && p->law[0].end[0].weight == 1);
    CHECK(p->law[0].end[1].dof == 0 && p->law[0].end[1].weight == -1);
    CHECK(p->law[1].effect == 2 && p->law[1].end[0].dof == 0 && p->law[1].end[0].weight == 1);
    CHECK(p->effect[0].active && !p->effect[1].active && !p->effect[3].active);
    program_free(p);
}

/* For each effect, a scene with it beside others: lowered without it, and without its row in the
 * table. */
/* Every effect once for each structure that takes it: D and E stand for two of the structure's
 * dofs. */
static const char *const one_of_each[] = {
    "{'type':'spring','dof':'D','stiffness':2}",
    "{'type':'damper','dof':'D','coefficient':2}",
    "{'type':'cubic_spring','dof':'D','coefficient':2}",
    "{'type':'polynomial_spring','dof':'D','coefficients':[1,2]}",
    "{'type':'friction','dof':'D','stiffness':2,'limit':3}",
    "{'type':'gap','dof':'D','stiffness':2,'clearance':3}",
    "{'type':'parametric_stiffness','dof':'D','stiffness':2}",
    "{'type':'polynomial_damper','dof':'D','coefficients':[-1,0,1]}",
    "{'type':'coulomb','dof':'D','limit':2}",
    "{'type':'regularised_coulomb','dof':'D','limit':2,'velocity':1e-3}",
    "{'type':'iwan','dof':'D','stiffnesses':[2,3],'limits':[3,4]}",
    "{'type':'lua','dof':'D','source':'function force(t,x,v,m) return x end'}",
    "{'type':'contact_friction','normal':'D','tangential':'E','normal_stiffness':2,'preload':1,"
    "'tangential_stiffness':2,'mu':0.2}",
    "{'type':'contact_bed','nodes':[{'normal':'D','tangential':{'D':1,'E':1}}],"
    "'normal_stiffness':2,'preload':1,'tangential_stiffness':2,'mu':0.2}",
    "{'type':'polynomial_coupling','terms':[{'coefficient':2,'powers':{'D':2,'E':1},'on':'E'}]}",
    "{'type':'axial_load','mean':1,'amplitude':2}",
    "{'type':'viscous_damping','per_length':2}",
    "{'type':'strain_rate_damping','mu':2}",
    "{'type':'modal_damping','ratio':0.1}",
    "{'type':'rayleigh_damping','alpha':2}",
    "{'type':'bearing','at':'left','transverse':2,'damping':1}",
    "{'type':'coupling','at':'right','transverse':2}",
    "{'type':'gyroscopic'}",
    "{'type':'rotary_inertia','I_rho':2}",
    "{'type':'clearance','at':'left','gap':1,'stiffness':2}",
    "{'type':'airloads','speed':400,'density':2e-3,'x_qc':-0.5,'inflow':'none'}",
    "{'type':'airloads','speed':400,'density':2e-3,'x_qc':-0.5,'inflow':'jones'}",
    "{'type':'airloads','speed':400,'density':2e-3,'x_qc':-0.5,'inflow':'peters_2d'}",
    "{'type':'airloads','speed':400,'density':2e-3,'x_qc':-0.5,'inflow':'peters_he'}"
};
static const struct { const char *name, *json, *D, *E;
} structures[] = {
    { "chain", "{'type':'chain','masses':[2,3],'springs':[4,5,0]}", "x1", "x2" },
    { "matrices", "{'type':'matrices','M':[[2,0],[0,3]],'K':[[4,-1],[-1,4]]}", "x1", "x2" },
    { "beam", "{'type':'beam','length':1,'elements':3,'EI':2,'mass_per_length':3}", "w1", "w2" },
    { "shaft",
      "{'type':'shaft','length':1,'elements':2,'EI':[2,3],'mass_per_length':3,'speed':7,'disk':"
      "{'position':0.5,'mass':2,'radius':0.3}}",
      "y1", "z1" },
    { "wing",
      "{'type':'wing','length':20,'chord':6,'elements':2,'EI':2e7,'GJ':2e6,'mass_per_length':0.7,"
      "'I_rho':2,'x_cg':0.6}",
      "w1", "phi3" }
};

static bool takes(const char *structure, const struct scene_effect_kind *effect)
{
    for (int i = 0; effect->structures != NULL && effect->structures[i] != NULL; i++)
        if (strcmp(effect->structures[i], structure) == 0)
            return true;
    return effect->structures == NULL;
}

/* EFFECT with D and E (as whole strings, of values and of keys) replaced. */
static cJSON *effect_on(const char *effect, const char *D, const char *E)
{
    char text[1000] = "";

    for (const char *at = effect; *at != '\0'; at++) {
        bool name = strncmp(at, "'D'", 3) == 0 || strncmp(at, "'E'", 3) == 0;
        size_t used = strlen(text);

        snprintf(text + used, sizeof text - used, name ? "'%s'" : "%.1s",
                 !name ? at : at[1] == 'D' ? D : E);
        at += name ? 2 : 0;
    }
    return scene_text(text);
}

static const struct scene_effect_kind *kind_of(const cJSON *effect)
{
    for (int k = 0; scene_effects[k] != NULL; k++)
        if (strcmp(scene_effects[k]->name, cJSON_GetObjectItem(effect, "type")->valuestring) == 0)
            return scene_effects[k];
    return NULL;
}

/* Listed and left out, or never written with its module out of the table: one program; listed,
 * another. */
static void check_without(const cJSON *structure, const cJSON *other, const cJSON *effect)
{
    static struct scene_options options;
    const struct scene_effect_kind *table[64] = { NULL };
    struct program *with = NULL, *without = NULL, *never = NULL;
    cJSON *scene = cJSON_CreateObject(), *effects;
    int n = 0;

    for (int k = 0; scene_effects[k] != NULL; k++)
        if (scene_effects[k] != kind_of(effect))
            table[n++] = scene_effects[k];
    cJSON_AddItemToObject(scene, "structure", cJSON_Duplicate(structure, 1));
    cJSON_AddNumberToObject(scene, "omega", 4);
    effects = cJSON_AddArrayToObject(scene, "effects");
    cJSON_AddItemToArray(effects, cJSON_Duplicate(other, 1));
    cJSON_AddItemToArray(effects, cJSON_Duplicate(effect, 1));
    CHECK(scene_lower(scene, NULL, &with, NULL) == MODAL_OK);
    memset(&options, 0, sizeof options);
    options.without[1] = true;
    CHECK(scene_lower(scene, &options, &without, NULL) == MODAL_OK);
    cJSON_DeleteItemFromArray(effects, 1);
    memset(&options, 0, sizeof options);
    options.effects = table;
    CHECK(scene_lower(scene, &options, &never, NULL) == MODAL_OK);
    CHECK_STRING(without->hash, never->hash);
    CHECK(strcmp(with->hash, never->hash) != 0);
    CHECK(without->effects == 1 && without->laws == never->laws &&
          program_states(without) == program_states(never));
    program_free(with);
    program_free(without);
    program_free(never);
    cJSON_Delete(scene);
}

TEST(a_scene_without_an_effect_is_the_scene_without_its_module)
{
    for (size_t s = 0; s < sizeof structures / sizeof *structures; s++) {
        cJSON *structure = scene_text(structures[s].json);
        bool met[64] = { false };

        for (size_t i = 0; i < sizeof one_of_each / sizeof *one_of_each; i++) {
            cJSON *effect = effect_on(one_of_each[i], structures[s].D, structures[s].E);
            bool spring = kind_of(effect) == scene_effects[0];
            cJSON *other =
                effect_on(spring ? one_of_each[1] : "{'type':'spring','dof':'E','stiffness':7}",
                          structures[s].D, structures[s].E);

            if (takes(structures[s].name, kind_of(effect)))
                check_without(structure, other, effect);
            for (int k = 0; scene_effects[k] != NULL; k++)
                met[k] |= scene_effects[k] == kind_of(effect);
            cJSON_Delete(effect);
            cJSON_Delete(other);
        }
        for (int k = 0; scene_effects[k] != NULL; k++)
            CHECK(met[k]);   /* a new effect is added to the list above */
        cJSON_Delete(structure);
    }
}

TEST(loads_initial_state_and_sensors_find_their_dofs)
{
    struct program *p =
        program_text("{" CHAIN ",'omega':3,'excitation':[{'dof':'x2','k':2,'cos':1.5,'sin':-2},{'"
                               "dof':'x1','type':'half_sine','amplitude':10,'duration':0.05},"
                               "{'dof':'x1','type':'table','points':[[0,1],[0.5,2],[2,0]]}],"
                               "'initial':{'x':{'x2':0.5},'v':{'x1':-1}},'sensors':[{'dof':'x2',"
                               "'derivative':2},{'dof':'x1'}]}");

    CHECK(p->loads == 3 && p->load[0].dof == 1 && p->load[0].k == 2 && p->load[0].sine == -2);
    CHECK(p->load[1].type == LOAD_HALF_SINE && p->load[1].duration == 0.05 &&
          p->load[2].points == 3 && p->load[2].force[1] == 2);
    CHECK(p->x0[1] == 0.5 && p->v0[0] == -1 && p->x0[0] == 0);
    CHECK(p->outputs == 2 && p->output[0].terms[0].i == 2 && p->output[0].terms[0].j == 1);
    CHECK_STRING(p->output[0].name, "x2_ddot");
    program_free(p);
}

TEST(what_is_wrong_in_a_scene_is_named_by_its_path)
{
    static const struct { const char *text, *field;
    } bad[] = {
        { "{}", "structure" },
        { "{'structure':{'type':'cable'}}", "structure.type" },
        { "{'structure':{'type':'chain','masses':[1],'springs':[1,1],'speed':1}}",
          "structure.speed" },
        { "{'structure':{'type':'chain','masses':[1,0],'springs':[1,1,1]}}",
          "structure.masses[1]" },
        { "{'structure':{'type':'chain','masses':[1,2],'springs':[1,1]}}", "structure.springs" },
        { "{'structure':{'type':'chain','masses':[1,2]}}", "structure.springs" },
        { "{'structure':{'type':'matrices','M':[[1,0],[0,1]],'K':[[1]]}}", "structure.K" },
        { "{'structure':{'type':'matrices','M':[[1,2],[3,4]],'K':[[1,0],[0,1]]}}", "structure.M" },
        { "{'structure':{'type':'matrices','M':[[1,2],[2,1]],'K':[[1,0],[0,1]]}}", "structure.M" },
        { "{'structure':{'type':'matrices','M':[[1,0],[0,0]],'K':[[1,0],[0,1]]}}", "structure.M" },
        { "{'structure':{'type':'matrices','M':[[1,0],[0,1]],'K':[[1,0],[0,1]],'G':[[0,1],[1,0]],"
          "'speed':1}}",
          "structure.G" },
        { "{'structure':{'type':'matrices','M':[[1,0],[0,1]],'K':[[1,0],[0,1]],'G':[[0,1],[-1,0]]}"
          "}",
          "structure.speed" },
        { "{'structure':{'type':'matrices','M':[[1,0],[0,1]],'K':[[1,0],[0,'a']]}}",
          "structure.K[1][1]" },
        { "{'structure':{'type':'matrices','M':[[1]],'K':[[1]],'dofs':['ground']}}",
          "structure.dofs[0]" },
        { "{'structure':{'type':'matrices','M':[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]],'K':"
          "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]],'dofs':['b','a','c','a']}}",
          "structure.dofs[3]" },
        { "{'structure':{'type':'matrices','M':[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]],'K':"
          "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]],'dofs':['b','a','b','a']}}",
          "structure.dofs[2]" },
        { "{'structure':{'type':'matrices','file':'X.h5'}}", "structure.file" },
        { "{'structure':{'type':'matrices','M':{'shape':[1,1],'row_pointers':[0,1],'columns':[1],"
          "'values':[1]},'K':[[1]]}}",
          "structure.M" },
        { "{'structure':{'type':'beam','length':1,'elements':2,'EI':1,'mass_per_length':-1}}",
          "structure.mass_per_length" },
        { "{'structure':{'type':'beam','length':1,'elements':2,'EI':1,'mass_per_length':1,"
          "'supports':['pinned','glued']}}",
          "structure.supports[1]" },
        { "{'structure':{'type':'beam','length':1,'elements':1,'EI':1,'mass_per_length':1,"
          "'supports':['clamped','clamped']}}",
          "structure.elements" },
        { "{" CHAIN ",'effect':[]}", "effect" },
        { "{" CHAIN ",'effects':[{'type':'spring','dof':'x1','stiffness':1},{'type':'spin'}]}",
          "effects[1].type" },
        { "{" CHAIN ",'effects':[{'type':'axial_load','mean':1}]}", "effects[0].type" },
        { "{" CHAIN ",'effects':[{'type':'spring','dof':'x9','stiffness':1}]}", "effects[0].dof" },
        { "{" CHAIN ",'effects':[{'type':'spring','dof':'x1','to':'x1','stiffness':1}]}",
          "effects[0].to" },
        { "{" CHAIN ",'effects':[{'type':'spring','dof':'ground','stiffness':1}]}",
          "effects[0].dof" },
        { "{" CHAIN ",'effects':[{'type':'spring','dof':'x1','stifness':1}]}",
          "effects[0].stifness" },
        { "{" CHAIN ",'effects':[{'type':'friction','dof':'x1','stiffness':1,'limit':-1}]}",
          "effects[0].limit" },
        { "{" CHAIN ",'effects':[{'type':'iwan','dof':'x1','stiffnesses':[1,2],'limits':[1]}]}",
          "effects[0].limits" },
        { "{" CHAIN
          ",'effects':[{'type':'gap','dof':'x1','stiffness':1,'clearance':-1,'both_sides':true}]}",
          "effects[0].clearance" },
        { "{" CHAIN ",'effects':[{'type':'parametric_stiffness','dof':'x1','stiffness':1}]}",
          "omega" },
        { "{" CHAIN ",'effects':[{'type':'polynomial_spring','dof':'x1'}]}",
          "effects[0].coefficients" },
        { "{" CHAIN ",'effects':[{'type':'modal_damping','ratios':[1,2,3]}]}",
          "effects[0].ratios" },
        { "{" CHAIN ",'effects':[{'type':'lua','dof':'x1','source':'function force('}]}",
          "effects[0].source" },
        { "{" CHAIN ",'omega':0}", "omega" },
        { "{" CHAIN ",'omega':1,'period':5,'effects':[{'type':'parametric_stiffness','dof':'x1','"
                    "stiffness':1}]}",
          "period" },
        { "{" CHAIN ",'initial':{'x':{'w9':1}}}", "initial.x.w9" },
        { "{" CHAIN ",'time':{'dt':1,'durations':2}}", "time.durations" },
        { "{" CHAIN ",'time':{'dt':0}}", "time.dt" },
        { "{" CHAIN ",'time':{'start':-1}}", "time.start" },
        { "{" CHAIN ",'time':3}", "time" },
        { "{" CHAIN ",'sensors':[{'dof':'x1','derivative':3}]}", "sensors[0].derivative" },
        { "{" CHAIN ",'excitation':[{'dof':'x1','k':1,'cos':1}]}", "omega" },
        { "{" CHAIN ",'excitation':[{'dof':'x1','type':'half_sine','amplitude':1}]}",
          "excitation[0].duration" },
        { "{" CHAIN ",'excitation':[{'dof':'x1','type':'table','points':[[0,1],[0,2]]}]}",
          "excitation[0].points[1]" },
        { "{" CHAIN ",'excitation':[{'dof':'x1','type':'step','amplitude':1,'frame':'fixed'}]}",
          "excitation[0].frame" },
    };

    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        refused(bad[i].text, MODAL_BAD_INPUT, bad[i].field);
}

/* A scene of COUNT elements of one Lua source. */
static enum modal_status lower_lua(int count, const char *source, struct program **out,
                                   struct modal_error *err)
{
    char element[512], *text = malloc((size_t)count * sizeof element + 256);
    enum modal_status rc;
    cJSON *scene;

    CHECK(text != NULL);
    snprintf(element, sizeof element, "{'type':'lua','dof':'x1','source':'%s'}", source);
    strcpy(text, "{" CHAIN ",'effects':[");
    for (int i = 0; i < count; i++)
        strcat(strcat(text, i > 0 ? "," : ""), element);
    strcat(text, "]}");
    scene = scene_text(text);
    rc = scene_lower(scene, NULL, out, err);
    cJSON_Delete(scene);
    free(text);
    return rc;
}

/* A Lua table of 200,000 numbers takes 16 bytes a number and up to as many again as it grows: 3.2
 * to 6.4 MB in each element, of 8. */
TEST(all_elements_in_lua_of_a_scene_have_one_budget)
{
    struct program *p = NULL;
    struct modal_error err;

    CHECK(lower_lua(1, "local k = {} for i = 1, 200000 do k[i] = i end "
                    "function force(t, x, v, m) return k[1] end", &p, &err) == MODAL_OK);
    CHECK(p->lua_bytes > 3200000 && p->lua_bytes <= LAW_LUA_MOST);
    program_free(p);
    p = NULL;
    CHECK(lower_lua(60, "local k = {} for i = 1, 200000 do k[i] = i end "
                    "function force(t, x, v, m) return k[1] end", &p, &err)
          == MODAL_ELEMENT_FAILED);
    CHECK(p == NULL
          && strstr(err.message, "all elements of a scene have at most "
                    "134217728 bytes together") != NULL);
    CHECK(strncmp(err.field, "effects[", 8) == 0 && strstr(err.field, "].source") != NULL);
    CHECK(lower_lua(1, "local k = {} for i = 1, 2000000 do k[i] = i end "
                    "function force(t, x, v, m) return k[1] end", &p, &err)
          == MODAL_ELEMENT_FAILED);
    CHECK(p == NULL && strstr(err.message, "an element has at most 8388608 bytes") != NULL);
    CHECK_STRING(err.field, "effects[0].source");
}

/* As many as a scene may have, each of the size that it has without data of its own. */
TEST(every_effect_that_a_scene_may_have_can_be_one_in_lua)
{
    struct program *p = NULL;
    struct modal_error err;

    if (lower_lua(SCENE_EFFECTS_MOST, "function force(t, x, v, m) return x end", &p, &err)
        != MODAL_OK)
        fail_msg("%s: %s", err.field, err.message);
    CHECK(p->laws == SCENE_EFFECTS_MOST && p->lua_bytes < LAW_LUA_TOGETHER_MOST);
    print_message("%zu bytes an element\n", p->lua_bytes / SCENE_EFFECTS_MOST);
    program_free(p);
}

/* 131,072 entries that were, of 16 bytes, are 131 us to pass: a million instructions took half a
 * minute where that was counted as one. */
#define EMPTIED "local t = {} for i = 1, 131072 do t[i] = i end " \
                "for i = 1, 131072 do t[i] = nil end "
#define FORCE "function force(t, x, v, m) return x end"

TEST(what_one_instruction_in_lua_makes_it_look_at_counts)
{
    static const char *const too_much[] = {
        EMPTIED "for i = 1, 100000 do next(t) end " FORCE,
        EMPTIED "for i = 1, 100000 do for k in pairs(t) do end end " FORCE,
        "local t = {} for i = 1, 131072 do t[i] = i end "
        "for i = 1, 100000 do next(t, 131071) end " FORCE,
        "local t = {[-1] = 1} for i = 1, 131072 do t[i] = i end "
        "for i = 2, 100000 do t[-i] = i t[-i] = nil end " FORCE,
    };
    struct program *p = NULL;
    struct modal_error err;

    for (size_t i = 0; i < sizeof too_much / sizeof *too_much; i++) {
        CHECK(lower_lua(1, too_much[i], &p, &err) != MODAL_OK);
        CHECK(strstr(err.message, "more than 1000000 instructions in one call") != NULL);
        CHECK_STRING(err.field, "effects[0].source");
    }
}

/* Walks, in themselves and inside each other, over tables of a thousand, which are built anew. */
TEST(tables_that_are_walked_once_cost_their_entries)
{
    struct program *p = NULL;
    struct modal_error err;

    if (lower_lua(1, "local t, sum = {}, 0 for i = 1, 1000 do t[i] = {i, -i, w = i} end "
                     "for k, of in pairs(t) do for _, x in pairs(of) do sum = sum + x end end "
                     "for k, of in next, t do sum = sum - of.w end assert(sum == 0) "
                     "assert(next({}) == nil and next({7}) == 1) "
                     FORCE, &p, &err) != MODAL_OK)
        fail_msg("%s: %s", err.field, err.message);
    program_free(p);
}

/* A law of one source, asked for its force and slope, twice. */
static enum modal_status ask_lua(const char *source, struct modal_error *err)
{
    struct program *p = NULL;
    struct law_force out = { 0 };
    double d = 1, v = 0.25;
    struct law_point at = { .t = 0.5, .d = &d, .v = &v };
    enum modal_status rc;

    CHECK(lower_lua(1, source, &p, err) == MODAL_OK && p->laws == 1);
    rc = p->law[0].kind->force(&p->law[0], &at, &out, err);
    if (rc == MODAL_OK)
        rc = p->law[0].kind->force(&p->law[0], &at, &out, err);
    CHECK(rc != MODAL_OK || fabs(out.f[0] - 3) < 1e-12);
    program_free(p);
    return rc;
}

TEST(copies_of_a_laws_memory_count_by_what_is_in_it)
{
    static const char *const accepted[] = {
        "function force(t, x, v, m) m.at = {} for i = 1, 5000 do m.at[i] = {i} end "
        "return 3 * x end",
        EMPTIED "function force(t, x, v, m) for i = 1, 10000 do m[i] = t end return 3 * x end",
        "function force(t, x, v, m) if not m.a then m.a = {m, 0} m.b = m.a end m.a[2] = m.a[2] + 1 "
        "assert(m.b[2] == m.a[2] and m.a[1] == m) return 3 * x end",
    };
    struct modal_error err;

    for (size_t i = 0; i < sizeof accepted / sizeof *accepted; i++)
        if (ask_lua(accepted[i], &err) != MODAL_OK)
            fail_msg("%zu: %s", i, err.message);
    CHECK(ask_lua("local many = {} for i = 1, 120000 do many[i] = i end "
                  "function force(t, x, v, m) m.of = many return 3 * x end", &err)
          == MODAL_ELEMENT_FAILED);
    CHECK(strstr(err.message, "more than 1000000 instructions in one call") != NULL);
}

/* LAW at D, d' = 0, its force alone or with its slopes. */
static enum modal_status ask(const struct law *law, double d, bool alone, struct law_force *out,
                             struct modal_error *err)
{
    double v = 0;
    struct law_point at = { .t = 0, .d = &d, .v = &v };

    *out = (struct law_force) { .alone = alone };
    return law->kind->force(law, &at, out, err);
}

/* The slope, which is 3 d^2, or the force alone. */
static double slope_of_cube(const struct law *law, double d, bool alone)
{
    struct modal_error err;
    struct law_force out;

    if (ask(law, d, alone, &out, &err) != MODAL_OK)
        fail_msg("%s", err.message);
    CHECK(fabs(out.f[0] / (d * d * d) - 1) < 1e-12);
    return out.fd[0][0];
}

/* cbrt(eps) of 1 squared is 4e-11 of the curvature; steps for 1e90 would say 1e168. */
TEST(slopes_in_lua_forget_the_size_of_a_motion_of_a_period_before_the_last)
{
    struct program *p = NULL;
    struct modal_error err;

    CHECK(lower_lua(1, "function force(t, x, v, m) return x^3 end", &p, &err) == MODAL_OK);
    slope_of_cube(&p->law[0], 1e90, false);
    p->law[0].kind->restart(&p->law[0]);
    slope_of_cube(&p->law[0], 1, true);
    p->law[0].kind->restart(&p->law[0]);
    CHECK(fabs(slope_of_cube(&p->law[0], 1, false) - 3) < 1e-9);
    program_free(p);
}

/* A motion begins at 0 but for rounding; a step of 1e-24 would leave 3 no digit to move. */
TEST(slopes_in_lua_at_the_first_instant_of_a_period_are_of_the_size_of_its_motion)
{
    struct program *p = NULL;
    struct modal_error err;
    struct law_force out;

    CHECK(lower_lua(1, "function force(t, x, v, m) return x + 3 end", &p, &err) == MODAL_OK);
    CHECK(ask(&p->law[0], 1e-18, true, &out, &err) == MODAL_OK);
    CHECK(ask(&p->law[0], 1, true, &out, &err) == MODAL_OK);
    p->law[0].kind->restart(&p->law[0]);
    CHECK(ask(&p->law[0], 1e-18, false, &out, &err) == MODAL_OK);
    CHECK(fabs(out.fd[0][0] - 1) < 1e-8);
    program_free(p);
}

/* Globals outlive `restart`: the source counts its calls itself and refuses the seventh. */
TEST(a_law_in_lua_is_called_once_for_its_force_and_five_times_with_its_slopes)
{
    struct program *p = NULL;
    struct modal_error err;
    struct law_force out;

    CHECK(lower_lua(1, "calls = 0 function force(t, x, v, m) calls = calls + 1 "
                       "if calls > 6 then error(calls) end return x^3 end", &p, &err) == MODAL_OK);
    slope_of_cube(&p->law[0], 1, true);
    slope_of_cube(&p->law[0], 1, false);
    CHECK(ask(&p->law[0], 1, true, &out, &err) == MODAL_ELEMENT_FAILED);
    CHECK(strstr(err.message, "7") != NULL && !out.beyond);
    program_free(p);
}

/* 1e200 cubed is no number: a motion too large where one of 1 had a number throughout a period, and
 * no word about that where the law was asked at rest alone. */
TEST(a_force_in_lua_that_is_no_number_tells_whether_the_motion_is_larger_than_a_whole_one_before)
{
    static const double before[] = { 0, 1 };
    struct modal_error err;

    for (int i = 0; i < 2; i++) {
        struct program *p = NULL;
        struct law_force out;

        CHECK(lower_lua(1, "function force(t, x, v, m) return x^3 end", &p, &err) == MODAL_OK);
        CHECK(ask(&p->law[0], before[i], true, &out, &err) == MODAL_OK);
        p->law[0].kind->restart(&p->law[0]);
        CHECK(ask(&p->law[0], 1e200, true, &out, &err) == MODAL_ELEMENT_FAILED);
        CHECK(out.beyond == (i == 1));
        program_free(p);
    }
}

/* In microns a law may end at what is no step in metres. */
TEST(slopes_in_lua_at_rest_are_found_where_the_law_ends_within_a_micron)
{
    struct program *p = NULL;
    struct modal_error err;
    struct law_force out;

    CHECK(lower_lua(1, "function force(t, x, v, m) return math.log(1 + 1e6 * x) end", &p, &err)
          == MODAL_OK);
    CHECK(ask(&p->law[0], 0, false, &out, &err) == MODAL_OK);
    CHECK(fabs(out.fd[0][0] / 1e6 - 1) < 1e-4 && out.fv[0][0] == 0);
    program_free(p);
}

TEST(a_law_in_lua_is_told_no_address)
{
    struct program *p = NULL;
    struct modal_error err;

    CHECK(lower_lua(1, "error(tostring(assert) .. tostring({}) .. tostring(0.5))", &p, &err)
          == MODAL_BAD_INPUT);
    CHECK_STRING(err.message, "lua: source:1: functiontable0.5");
}

TEST(a_record_has_duration_over_dt_plus_one_samples)
{
    static const struct { const char *time; long samples;
    } cases[] = { { "{'dt':0.1,'duration':1}", 11 },
                  { "{'dt':0.001,'duration':0.3}", 301 },
                  { "{'dt':0.3,'duration':1}", 4 },
                  { "{'dt':0.1,'duration':0}", 1 },
                  { "{'dt':0.0078539816339744833,'periods':3}", 301 } };   /* 2 pi / 8 / 100 */
    char text[512];

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct scene_time t;
        snprintf(text, sizeof text, "{" CHAIN ",'omega':8,'time':%s}", cases[i].time);
        struct program *p = program_text(text);
        cJSON *scene = scene_text(text);
        CHECK(scene_time(scene, p, &t, NULL) == MODAL_OK);
        CHECK(t.samples == cases[i].samples);
        cJSON_Delete(scene);
        program_free(p);
    }
}
