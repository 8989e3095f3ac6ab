/* test_wing.c - the wing as a scene: its program is the model's, its states are counted, its wrong
 * keys are named */
#include "check.h"
#include <stdlib.h>
#include "base/json.h"
#include "modal/scene/program.h"
#include "modal/scene/scene.h"
#include "modal/scene/wing_model.h"

#define WING \
    "\"structure\":{\"type\":\"wing\",\"length\":20,\"chord\":6,\"elements\":4,\"EI\":2.4e7," \
    "\"GJ\":2.4e6,\"mass_per_length\":0.75," \
    "\"I_rho\":1.95,\"x_cg\":0.6}"
#define AIR(INFLOW) \
    "{\"type\":\"airloads\",\"speed\":585,\"density\":0.0019791,\"lift_slope\":6.28," \
    "\"x_qc\":-0.5,\"stations\":9," INFLOW "}"

static enum modal_status lower(const char *text, struct program **p, struct modal_error *err)
{
    cJSON *scene = NULL;
    enum modal_status rc;

    CHECK(json_read(text, strlen(text), &scene, NULL) == MODAL_OK);
    rc = scene_lower(scene, NULL, p, err);
    cJSON_Delete(scene);
    return rc;
}

TEST(each_inflow_brings_its_states_and_no_others)
{
    static const struct { const char *scene; int states; } cases[] = {
        { "{" WING "}", 0 },
        { "{" WING ",\"effects\":[" AIR("\"inflow\":\"none\"") "]}", 0 },
        { "{" WING ",\"effects\":[" AIR("\"inflow\":\"peters_2d\"") "]}", 54 },
        { "{" WING ",\"effects\":[" AIR("\"inflow\":\"peters_2d\",\"inflow_states\":4") "]}", 36 },
        { "{" WING ",\"effects\":[" AIR("\"inflow\":\"jones\"") "]}", 18 },
        { "{" WING ",\"effects\":[" AIR("\"inflow\":\"peters_he\"") "]}", 30 },
        { "{" WING ",\"effects\":[" AIR("\"inflow\":\"peters_he\",\"inflow_states\":20") "]}", 20 },
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct program *p = NULL;

        CHECK(lower(cases[i].scene, &p, NULL) == MODAL_OK);
        CHECK(p->n == 20 && program_states(p) == 40 + cases[i].states);
        CHECK(program_class(p) == PROGRAM_LINEAR_CONSTANT);
        CHECK(p->effects == 0 || (p->effect[0].states == cases[i].states && p->effect[0].active));
        CHECK_STRING(p->dofs[0], "w1");
        CHECK_STRING(p->dofs[7], "wp4");
        CHECK_STRING(p->dofs[19], "phi12");
        program_free(p);
    }
}

/* A station's lift integrated with the Gauss weights is the generalised force of a rigid plunge:
 * sum of W L' = -(row of M a + ...). */
TEST(the_stations_lift_is_the_force_in_the_equations)
{
    static const char scene[] = "{" WING ",\"effects\":[" AIR(
        "\"inflow\":\"peters_he\"") "],\"sensors\":["
                                    "{\"station\":0,\"quantity\":\"lift\"},{\"station\":8,"
                                    "\"quantity\":\"moment\"},{\"position\":15,"
                                    "\"quantity\":\"phi\"},{\"position\":20,\"quantity\":\"w\","
                                    "\"derivative\":1},{\"dof\":\"wp4\",\"derivative\":2}]}";
    const struct wing goland = { 20, 6, 4, 2.4e7, 2.4e6, 0.75, 1.95, 0.6 };
    const struct airloads a = { 585, 0.0019791, 6.28, -0.5, 9, &inflow_peters_he, 30 };
    struct airloads_matrices air;
    struct program *p = NULL;

    CHECK(lower(scene, &p, NULL) == MODAL_OK);
    CHECK(p->outputs == 5);
    CHECK_STRING(p->output[0].name, "lift_0");
    CHECK_STRING(p->output[1].name, "moment_8");
    CHECK_STRING(p->output[2].name, "phi(15)");
    CHECK_STRING(p->output[3].name, "w(20)_dot");
    /* the tip's w4 itself */
    CHECK(p->output[3].count == 1 && p->output[3].terms[0].i == 1 && p->output[3].terms[0].j == 6);
    CHECK(airloads_new(&goland, &a, &air, NULL) == MODAL_OK);
    /* the rows times N_w(y_g)^T summed: column j of K, by quadrature */
    for (int j = 0; j < 20; j++) {
        double sum = 0, K = 0;

        for (int g = 0; g < 9; g++) {
            double at_w[20], at_phi[20];

            wing_rows(&goland, air.position[g], at_w, at_phi);
            sum -= air.weight[g] *
                   (at_w[6] * air.lift[0][g * 20 + j] + at_phi[6] * air.moment[0][g * 20 + j]);
        }
        K = air.K[6 * 20 + j];
        CHECK_NEAR(sum, K, 1e-12 * (1 + fabs(K)));
    }
    airloads_done(&air);
    program_free(p);
}

TEST(every_wrong_key_is_named_by_its_path)
{
    static const struct { const char *scene, *field;
    } wrong[] = {
        { "{" WING ",\"effects\":[" AIR("\"inflow\":\"wagner\"") "]}", "effects[0].inflow" },
        { "{" WING ",\"effects\":[" AIR("\"inflow\":\"peters_he\",\"inflow_states\":29") "]}",
          "effects[0].inflow_states" },
        { "{" WING ",\"effects\":[" AIR("\"inflow\":\"peters_he\",\"inflow_states\":55") "]}",
          "effects[0].inflow_states" },
        { "{" WING ",\"effects\":[" AIR("\"inflow\":\"jones\",\"inflow_states\":3") "]}",
          "effects[0].inflow_states" },
        { "{" WING ",\"effects\":[" AIR("\"inflow\":\"none\",\"inflow_states\":1") "]}",
          "effects[0].inflow_states" },
        { "{" WING ",\"effects\":[" AIR("\"inflow\":\"none\",\"chord\":1") "]}",
          "effects[0].chord" },
        { "{" WING ",\"effects\":[" AIR("\"inflow\":\"none\"") "," AIR("\"inflow\":\"none\"") "]}",
          "effects[1]" },
        { "{" WING ",\"effects\":[{\"type\":\"airloads\",\"speed\":-1,\"density\":1,\"x_qc\":0}]}",
          "effects[0].speed" },
        { "{" WING ",\"effects\":[{\"type\":\"airloads\",\"speed\":1,\"x_qc\":0}]}",
          "effects[0].density" },
        { "{" WING ",\"effects\":[{\"type\":\"bearing\",\"at\":\"left\"}]}", "effects[0].type" },
        { "{" WING ",\"sensors\":[{\"station\":0,\"quantity\":\"lift\"}]}", "sensors[0].station" },
        { "{" WING ",\"effects\":[" AIR(
              "\"inflow\":\"none\"") "],\"sensors\":[{\"station\":9,\"quantity\":\"lift\"}]}",
          "sensors[0].station" },
        { "{" WING ",\"effects\":[" AIR(
              "\"inflow\":\"none\"") "],\"sensors\":[{\"station\":1,\"quantity\":\"drag\"}]}",
          "sensors[0].quantity" },
        { "{" WING ",\"sensors\":[{\"position\":20.5,\"quantity\":\"w\"}]}",
          "sensors[0].position" },
        { "{" WING ",\"sensors\":[{\"dof\":\"w0\"}]}", "sensors[0].dof" },
        { "{\"structure\":{\"type\":\"wing\",\"length\":20,\"chord\":6,\"elements\":4,\"EI\":1,"
          "\"GJ\":1,\"mass_per_length\":1,\"I_rho\":0.3,\"x_cg\":0.6}}",
          "structure.I_rho" },
        { "{\"structure\":{\"type\":\"wing\",\"length\":20,\"chord\":6,\"EI\":1,\"GJ\":1,"
          "\"mass_per_length\":1,\"I_rho\":2,\"x_cg\":0.6}}",
          "structure.elements" },
    };

    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        struct program *p = NULL;
        struct modal_error err = { 0 };

        CHECK(lower(wrong[i].scene, &p, &err) == MODAL_BAD_INPUT);
        CHECK_STRING(err.field, wrong[i].field);
        CHECK(p == NULL);
    }
}

/* A wing without airloads is the program that a table without the airloads' row gives. */
TEST(without_airloads_no_trace_of_them_is_left)
{
    const struct scene_effect_kind *table[64];
    struct scene_options options = { .effects = table };
    struct program *p = NULL, *q = NULL;
    cJSON *scene = NULL;
    int n = 0;

    for (; scene_effects[n] != NULL; n++) {
        CHECK(n < 63);
        table[n] = scene_effects[n];
    }
    table[n] = NULL;
    for (int i = 0; i < n; i++) {                      /* each row left out in turn */
        memmove(&table[i], &table[i + 1], (size_t)(n - i) * sizeof *table);
        CHECK(json_read("{" WING "}", strlen("{" WING "}"), &scene, NULL) == MODAL_OK);
        CHECK(scene_lower(scene, &options, &p, NULL) == MODAL_OK);
        CHECK(scene_lower(scene, NULL, &q, NULL) == MODAL_OK);
        CHECK_STRING(p->hash, q->hash);
        program_free(p);
        program_free(q);
        cJSON_Delete(scene);
        memmove(&table[i + 1], &table[i], (size_t)(n - i) * sizeof *table);
        table[i] = scene_effects[i];
    }
}
