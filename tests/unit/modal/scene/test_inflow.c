/* test_inflow.c - inflow models against the reference's matrices (tests/data/wing/unit_checks.json)
 * and known limits; inflow_kinds.c is walked by test_scene_key.c (its words, by their rows)
 *
 * The reference prints 12 decimals; the bar is 1e-9 of the largest entry of each matrix.
 */
/* Tests as well: inflow_kinds.c jones.c peters_2d.c peters_he.c quadrature.c */
#include "check.h"
#include <stdlib.h>
#include "base/json.h"
#include "modal/scene/inflow/inflow.h"
#include "modal/scene/inflow/peters_he.h"
#include "modal/scene/quadrature.h"

static cJSON *reference(void)
{
    static char text[65536];
    FILE *f = fopen(TEST_DATA "/wing/unit_checks.json", "r");
    cJSON *json = NULL;

    CHECK(f != NULL);
    size_t length = fread(text, 1, sizeof text, f);
    fclose(f);
    CHECK(json_read(text, length, &json, NULL) == MODAL_OK);
    return json;
}

static double at1(const cJSON *list, int i)
{
    return cJSON_GetArrayItem(list, i)->valuedouble;
}

static double at2(const cJSON *rows, int i, int j)
{
    return at1(cJSON_GetArrayItem(rows, i), j);
}

static const cJSON *member(const cJSON *json, const char *key)
{
    const cJSON *found = cJSON_GetObjectItem(json, key);

    CHECK(found != NULL);
    return found;
}

TEST(the_stations_are_those_of_gauss_and_legendre)
{
    cJSON *ref = reference();
    double y[9], w[9];

    gauss_legendre(9, 20, y, w);
    for (int i = 0; i < 9; i++) {
        CHECK_NEAR(y[i], at1(member(ref, "stations_y_ft"), i), 1e-11);
        CHECK_NEAR(w[i], at1(member(ref, "stations_weight_ft"), i), 1e-11);
    }
    cJSON_Delete(ref);
}

TEST(n_gauss_points_integrate_degree_2n_minus_1_exactly)
{
    for (int n = 1; n <= 64; n++) {
        double y[64], w[64], sum = 0, total = 0;

        gauss_legendre(n, 1.7, y, w);
        for (int i = 0; i < n; i++) {
            sum += w[i] * pow(y[i] / 1.7, 2 * n - 1);
            total += w[i];
        }
        CHECK_NEAR(sum, 1.7 / (2 * n), 1e-13);
        CHECK_NEAR(total, 1.7, 1e-13);
    }
}

TEST(peters_he_matrices_equal_the_reference_to_1e_9)
{
    struct peters_he_index index[PETERS_HE_STATES_MOST];
    cJSON *ref = reference();

    CHECK(peters_he_states(9, index) == 30);
    for (int i = 0; i < 30; i++) {
        CHECK(index[i].m == (int)at2(member(ref, "peters_he_index_m_n_cosine"), i, 0));
        CHECK(index[i].n == (int)at2(member(ref, "peters_he_index_m_n_cosine"), i, 1));
        CHECK_NEAR(peters_he_K(index[i]), at1(member(ref, "K_diag"), i), 1e-9);
        for (int j = 0; j < 30; j++)
            CHECK_NEAR(peters_he_L(index[i], index[j]), at2(member(ref, "L_cos_X1"), i, j), 1e-9);
    }
    cJSON_Delete(ref);
}

TEST(peters_he_shapes_and_their_forcing_equal_the_reference_to_1e_9)
{
    struct peters_he_index index[PETERS_HE_STATES_MOST];
    cJSON *ref = reference();
    double y[9], weight[9];
    const double U = 123.4, b = 3, a0 = 6.28;
    struct inflow_wing wing = { 20, b, U, a0, 9, y, weight };
    struct inflow f;

    gauss_legendre(9, 20, y, weight);
    peters_he_states(9, index);
    CHECK(inflow_new(&inflow_peters_he, &wing, 30, &f, NULL) == MODAL_OK);
    CHECK(f.states == 30);
    for (int g = 0; g < 9; g++)
        for (int i = 0; i < 30; i++) {
            double tau = f.P[i * 9 + g] / (U * a0 * b / 20 / 2);

            CHECK_NEAR(f.Lambda[g * 30 + i], at2(member(ref, "Phi_stations"), g, i), 1e-9);
            CHECK_NEAR(tau, at2(member(ref, "Tau_per_unit_lift_over_rhoUR"), i, g), 1e-9);
        }
    inflow_done(&f);
    cJSON_Delete(ref);
}

/* (2) of peters_he.c at rest: with the lift given, alpha = L tau / 2; so -A alpha = P v must hold
 * with v = lift + lambda. */
TEST(peters_he_in_steady_flow_gives_half_L_tau)
{
    struct peters_he_index index[PETERS_HE_STATES_MOST];
    double y[5], weight[5], alpha[12] = { 0 }, v[5];
    const double U = 77, b = 1.5, a0 = 6.1, R = 13, slope = a0 * b / R,
                 lift[5] = { 0.3, 0.7, -0.2, 0.9, 0.4 };
    struct inflow_wing wing = { R, b, U, a0, 5, y, weight };
    struct inflow f;

    gauss_legendre(5, R, y, weight);
    CHECK(peters_he_states(5, index) == 12);
    CHECK(inflow_new(&inflow_peters_he, &wing, 12, &f, NULL) == MODAL_OK);
    for (int i = 0; i < 12; i++)
        for (int j = 0; j < 12; j++)
            for (int g = 0; g < 5; g++)
                alpha[i] += peters_he_L(index[i], index[j]) * f.P[j * 5 + g] / (U * slope) *
                            lift[g];
    for (int g = 0; g < 5; g++) {
        v[g] = lift[g] / slope;                        /* lift = slope (v - lambda) */
        for (int i = 0; i < 12; i++)
            v[g] += f.Lambda[g * 12 + i] * alpha[i];
    }
    for (int i = 0; i < 12; i++) {
        double rate = 0, scale = 0;

        for (int j = 0; j < 12; j++) {
            rate += f.A[i * 12 + j] * alpha[j];
            scale += fabs(f.A[i * 12 + j] * alpha[j]);
        }
        for (int g = 0; g < 5; g++)
            rate += f.P[i * 5 + g] * v[g];
        CHECK_NEAR(rate, 0, 1e-12 * scale);
    }
    inflow_done(&f);
}

TEST(peters_2d_matrices_equal_the_reference)
{
    cJSON *ref = reference();
    const cJSON *of = member(ref, "peters2d_N6");
    double y[1] = { 1 }, weight[1] = { 2 };
    struct inflow_wing wing = { 2, 3, 100, 6.28, 1, y, weight };
    struct inflow f;

    CHECK(inflow_new(&inflow_peters_2d, &wing, 6, &f, NULL) == MODAL_OK);
    for (int i = 0; i < 6; i++) {
        CHECK_NEAR(f.Lambda[i], at1(member(of, "b"), i) / 2, 1e-12);
        CHECK_NEAR(f.Q[i], at1(member(of, "c"), i), 1e-11);
        for (int j = 0; j < 6; j++)
            CHECK_NEAR(f.E[i * 6 + j], at2(member(of, "A"), i, j), 1e-9);
    }
    inflow_done(&f);
    cJSON_Delete(ref);
}

/* The sum of b_n is 1 and lambda follows a fast change of v by half: 1/2 b' A^-1 c = 1/2, Wagner's
 * start. */
TEST(peters_2d_starts_with_half_the_lift_as_wagner_does)
{
    for (int N = 1; N <= 10; N++) {
        double y[1] = { 1 }, weight[1] = { 2 }, sum = 0;
        struct inflow_wing wing = { 2, 1, 1, 6.28, 1, y, weight };
        struct inflow f;

        CHECK(inflow_new(&inflow_peters_2d, &wing, N, &f, NULL) == MODAL_OK);
        for (int n = 0; n < N; n++)
            sum += 2 * f.Lambda[n];
        CHECK_NEAR(sum, 1, 1e-9);
        inflow_done(&f);
    }
}

/* In steady flow the lags have caught up: direct - sum Lambda P / A = 1. */
TEST(jones_ends_with_the_whole_lift)
{
    double y[2] = { 1, 2 }, weight[2] = { 1, 2 };
    struct inflow_wing wing = { 3, 1.3, 47, 6.28, 2, y, weight };
    struct inflow f;

    CHECK(inflow_new(&inflow_jones, &wing, 2, &f, NULL) == MODAL_OK);
    CHECK(f.states == 4);
    for (int s = 0; s < 2; s++) {
        double steady = f.direct;

        for (int i = 0; i < 4; i++)
            steady += f.Lambda[s * 4 + i] * f.P[i * 2 + s] / f.A[i * 4 + i];
        CHECK_NEAR(steady, 1, 1e-14);
    }
    inflow_done(&f);
}

TEST(only_whole_orders_are_accepted)
{
    CHECK(peters_he_order(30) == 9 && peters_he_order(20) == 7 && peters_he_order(25) == 8);
    CHECK(peters_he_order(72) == 15 && peters_he_order(1) == 0);
    CHECK(peters_he_order(29) == -1 && peters_he_order(55) == -1 && peters_he_order(0) == -1 &&
          peters_he_order(81) == -1);
    CHECK(!inflow_peters_he.valid(31) && inflow_peters_he.valid(30));
    CHECK(!inflow_peters_2d.valid(0) && inflow_peters_2d.valid(6) && !inflow_peters_2d.valid(11));
    CHECK(inflow_jones.valid(2) && !inflow_jones.valid(3));
    CHECK(inflow_none.valid(0) && !inflow_none.valid(1));
}
