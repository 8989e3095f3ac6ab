/*
 * wing_model.c - bending-torsion wing and its airloads
 *
 * Structure, with N the Hermite cubics of w and L the Lagrange cubics of phi on an element:
 *
 *     T = 1/2 int [ m w_t^2 - 2 m x_cg w_t phi_t + I_rho phi_t^2 ] dy                           (1)
 *     V = 1/2 int [ EI w''^2 + GJ phi'^2 ] dy                                                   (2)
 *
 * integrated exactly (four Gauss points: degree 7).  Airloads per length at a station, b = chord/2,
 * a the elastic axis aft of mid-chord in semichords, a = (-x_qc - b/2)/b, and A = pi rho b^2:
 *
 *     v   = U phi - w_t + b (1/2 - a) phi_t                                                     (3)
 *     Lc  = a0 rho U b (direct v - Lambda z)                                                    (4)
 *     L'  = A (-w_tt + U phi_t - b a phi_tt) + Lc                                               (5)
 *     M'  = A (-b a w_tt - U b (1/2 - a) phi_t - b^2 (1/8 + a^2) phi_tt) - x_qc Lc              (6)
 *
 * The generalised force is sum_g W_g (N_w(y_g)^T L' + N_phi(y_g)^T M').  (5) and (6) are rows over
 * x, x', x'', z, so the left-hand side gains the negative of that sum, row by row; the states
 * follow (2) of inflow.h with (3) put in.
 *
 * Source: the wing's model document (section 7.3 of the identification paper), equations of its
 * sections 2 and 3.
 */
#include "modal/scene/wing_model.h"
#include "modal/scene/hermite.h"
#include "modal/scene/quadrature.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

int wing_dofs(const struct wing *w)
{
    return 5 * w->elements;
}

/* Lagrange cubics on nodes 0, 1/3, 2/3, 1 and their derivatives by x = xi h. */
static void lagrange(double h, double xi, double n[4], double slope[4])
{
    double s = 3 * xi;  /* nodes at whole s */

    n[0] = (1 - s) * (2 - s) * (3 - s) / 6;
    n[1] = s * (2 - s) * (3 - s) / 2;
    n[2] = s * (s - 1) * (3 - s) / 2;
    n[3] = s * (s - 1) * (s - 2) / 6;
    if (slope == NULL)
        return;
    slope[0] = (-11 + 12 * s - 3 * s * s) / 2 / h;
    slope[1] = (18 - 30 * s + 9 * s * s) / 2 / h;
    slope[2] = (-9 + 24 * s - 9 * s * s) / 2 / h;
    slope[3] = (2 - 6 * s + 3 * s * s) / 2 / h;
}

void wing_element(const struct wing *w, double M[64], double K[64])
{
    double h = w->length / w->elements, xi[4], weight[4], nw[4], nt[4], dt[4], k[16], m[16];

    gauss_legendre(4, 1, xi, weight);  /* exact to degree 7 */
    hermite_stiffness(w->EI, h, k);
    hermite_mass(w->mass_per_length, h, m);
    memset(M, 0, 64 * sizeof *M);
    memset(K, 0, 64 * sizeof *K);
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++) {
            M[8 * i + j] = m[4 * i + j];
            K[8 * i + j] = k[4 * i + j];
        }
    for (int g = 0; g < 4; g++) {
        hermite_shape(h, xi[g], nw, NULL);
        lagrange(h, xi[g], nt, dt);
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++) {
                /* (1): -m x_cg w_t phi_t */
                double coupling = -w->mass_per_length * w->x_cg * nw[i] * nt[j] * h * weight[g];

                M[8 * i + 4 + j] += coupling;
                M[8 * (4 + j) + i] += coupling;
                M[8 * (4 + i) + 4 + j] += w->I_rho * nt[i] * nt[j] * h * weight[g];
                K[8 * (4 + i) + 4 + j] += w->GJ * dt[i] * dt[j] * h * weight[g];  /* (2) */
            }
    }
}

void wing_element_dofs(const struct wing *w, int element, int dof[8])
{
    for (int i = 0; i < 4; i++) {
        /* of node `element` = element's inner end; the root's are < 0 */
        dof[i] = 2 * (element - 1) + i;
        dof[4 + i] = 3 * element + i - 1;
        dof[4 + i] = dof[4 + i] < 0 ? -1 : 2 * w->elements + dof[4 + i];
        if (dof[i] < 0)
            dof[i] = -1;
    }
}

void wing_rows(const struct wing *w, double y, double *row_w, double *row_phi)
{
    double h = w->length / w->elements, nw[4], nt[4];
    int element = (int)(y / h), dof[8];  /* the tip belongs to the last */

    if (element > w->elements - 1)
        element = w->elements - 1;
    hermite_shape(h, y / h - element, nw, NULL);
    lagrange(h, y / h - element, nt, NULL);
    wing_element_dofs(w, element, dof);
    for (int i = 0; i < wing_dofs(w); i++) {
        if (row_w != NULL)
            row_w[i] = 0;
        if (row_phi != NULL)
            row_phi[i] = 0;
    }
    for (int i = 0; i < 4; i++) {
        if (row_w != NULL && dof[i] >= 0)
            row_w[dof[i]] = nw[i];
        if (row_phi != NULL && dof[4 + i] >= 0)
            row_phi[dof[4 + i]] = nt[i];
    }
}

/* All matrices of the airloads, zeros; airloads_done frees. */
static enum modal_status allocate(struct airloads_matrices *m, struct modal_error *err)
{
    size_t n = (size_t)m->n, ns = (size_t)m->ns, nz = (size_t)m->nz;
    struct { double **at; size_t count;
    } all[] = {
        { &m->position, ns },      { &m->weight, ns },        { &m->lift[0], ns * n },
        { &m->lift[1], ns * n },   { &m->lift[2], ns * n },   { &m->moment[0], ns * n },
        { &m->moment[1], ns * n }, { &m->moment[2], ns * n }, { &m->lift_z, ns * nz },
        { &m->moment_z, ns * nz }, { &m->M, n * n },          { &m->C, n * n },
        { &m->K, n * n },          { &m->F, n * nz },         { &m->Bx, nz * n },
        { &m->Bv, nz * n },        { &m->Ba, nz * n },
    };

    for (size_t i = 0; i < sizeof all / sizeof *all; i++) {
        *all[i].at = calloc(all[i].count + 1, sizeof(double));
        if (*all[i].at == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "airloads: out of memory for %d dofs", m->n);
    }
    return MODAL_OK;
}

/* Rows (4) .. (6) of one station; rw, rp are its rows of w and phi. */
static void station_rows(const struct airloads *a, double b, const double *rw, const double *rp,
                         int s, struct airloads_matrices *m)
{
    size_t at = (size_t)s * (size_t)m->n;
    /* arm = b (1/2 - a) */
    double axis = (-a->x_qc - b / 2) / b, arm = b + a->x_qc, U = a->speed;
    double apparent = M_PI * a->density * b * b, circulatory = a->lift_slope * a->density * U * b;

    for (int j = 0; j < m->n; j++) {
        double lc[2] = { circulatory * m->flow.direct * U * rp[j],
                         circulatory * m->flow.direct * (arm * rp[j] - rw[j]) };

        m->lift[0][at + (size_t)j] = lc[0];
        m->lift[1][at + (size_t)j] = lc[1] + apparent * U * rp[j];  /* (5), on x' */
        m->lift[2][at + (size_t)j] = -apparent * (rw[j] + b * axis * rp[j]);  /* (5), on x'' */
        m->moment[0][at + (size_t)j] = -a->x_qc * lc[0];  /* (6): -x_qc Lc */
        m->moment[1][at + (size_t)j] = -a->x_qc * lc[1] - apparent * U * arm * rp[j];
        m->moment[2][at + (size_t)j] =
            -apparent * (b * axis * rw[j] + b * b * (0.125 + axis * axis) * rp[j]);
    }
    for (int k = 0; k < m->nz; k++) {
        size_t i = (size_t)s * (size_t)m->nz + (size_t)k;

        m->lift_z[i] = -circulatory * m->flow.Lambda[i];
        m->moment_z[i] = a->x_qc * circulatory * m->flow.Lambda[i];
    }
}

/* The station's share of the generalised force, to the left-hand side (M, C, K) and to F. */
static void station_loads(const double *rw, const double *rp, int s, struct airloads_matrices *m)
{
    double *left[3] = { m->K, m->C, m->M };
    size_t n = (size_t)m->n, nz = (size_t)m->nz, at = (size_t)s;

    for (size_t i = 0; i < n; i++) {
        double lift = m->weight[s] * rw[i], moment = m->weight[s] * rp[i];

        if (lift == 0 && moment == 0)
            continue;
        for (int q = 0; q < 3; q++)
            for (size_t j = 0; j < n; j++)
                left[q][i * n + j] -=
                    lift * m->lift[q][at * n + j] + moment * m->moment[q][at * n + j];
        for (size_t k = 0; k < nz; k++)
            m->F[i * nz + k] += lift * m->lift_z[at * nz + k] + moment * m->moment_z[at * nz + k];
    }
}

/* The station's normalwash (3) and its rate, into the states' equations. */
static void station_states(const struct airloads *a, double b, const double *rw, const double *rp,
                           int s, struct airloads_matrices *m)
{
    double arm = b + a->x_qc;
    size_t n = (size_t)m->n;

    for (size_t k = 0; k < (size_t)m->nz; k++) {
        double P = m->flow.P[k * (size_t)m->ns + (size_t)s],
               Q = m->flow.Q[k * (size_t)m->ns + (size_t)s];

        for (size_t j = 0; j < n; j++) {
            double on_x = a->speed * rp[j], on_v = arm * rp[j] - rw[j];  /* (3) */

            m->Bx[k * n + j] += P * on_x;
            m->Bv[k * n + j] += P * on_v + Q * on_x;
            m->Ba[k * n + j] += Q * on_v;  /* v' reads x'' */
        }
    }
}

enum modal_status airloads_new(const struct wing *w, const struct airloads *a,
                               struct airloads_matrices *out, struct modal_error *err)
{
    double position[WING_STATIONS_MOST], weight[WING_STATIONS_MOST], b = w->chord / 2;
    struct inflow_wing at = {
        w->length, b, a->speed, a->lift_slope, a->stations, position, weight
    };
    struct airloads_matrices m = { .n = wing_dofs(w), .ns = a->stations };
    double *rows = NULL;
    enum modal_status rc;

    gauss_legendre(a->stations, w->length, position, weight);  /* W_g of the generalised force */
    rc = inflow_new(a->inflow, &at, a->inflow_states, &m.flow, err);
    m.nz = m.flow.states;
    if (rc == MODAL_OK)
        rc = allocate(&m, err);
    rows = calloc(2 * (size_t)m.n + 1, sizeof *rows);
    if (rc == MODAL_OK && rows == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "airloads: out of memory for %d dofs", m.n);
    if (rc != MODAL_OK)
        goto out;
    memcpy(m.position, position, (size_t)m.ns * sizeof *position);
    memcpy(m.weight, weight, (size_t)m.ns * sizeof *weight);
    for (int s = 0; s < m.ns; s++) {
        double *rw = rows, *rp = rows + m.n;

        wing_rows(w, position[s], rw, rp);
        station_rows(a, b, rw, rp, s, &m);
        station_loads(rw, rp, s, &m);
        station_states(a, b, rw, rp, s, &m);  /* (2) of inflow.h with (3) */
    }
    *out = m;
    m = (struct airloads_matrices) { 0 };
out:
    free(rows);
    airloads_done(&m);
    return rc;
}

void airloads_done(struct airloads_matrices *m)
{
    double *all[] = { m->position,  m->weight,    m->lift[0], m->lift[1],  m->lift[2], m->moment[0],
                      m->moment[1], m->moment[2], m->lift_z,  m->moment_z, m->M,       m->C,
                      m->K,         m->F,         m->Bx,      m->Bv,       m->Ba };

    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        free(all[i]);
    inflow_done(&m->flow);
    *m = (struct airloads_matrices) { 0 };
}
