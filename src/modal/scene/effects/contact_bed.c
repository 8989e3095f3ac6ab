/* contact_bed.c - contact with friction over the nodes of a joint, as one effect
 *
 * Each node is a contact_friction whose normal_stiffness, preload and tangential_stiffness are
 * those of an area times its own.  With two tangential directions t and u the normal force N is
 * one, and
 *
 *     |f_t| <= mu N,   |f_u| <= mu N,                                                           (1)
 *
 * each with a slider of its own: the bound is a square of side 2 mu N about the circle of that
 * radius.  It holds up to sqrt(2) too much obliquely, and is exact along t and u, for which their
 * directions are best chosen.  A slider that turns on the circle has no events in closed form, and
 * those are what makes forces exact (pieces.h) and steps end where a regime does.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/lowering.h"

enum { NODES_MOST = 20000 };         /* chosen: a patch of 140 by 140 */

struct bed {
    const cJSON *nodes;
    double normal_stiffness, preload, tangential_stiffness, mu;
};

struct node {
    struct scene_ends normal;
    const cJSON *tangential;
    double area;
    double normal_stiffness, preload, tangential_stiffness, mu;  /* its own; NAN: the bed's */
};

static const struct scene_key node_keys[] = {
    { "normal", SCENE_PLACE, offsetof(struct node, normal), "", .needed = true,
      .means = "d_n into the contact: a dof, or weights by dof name", .example = "\"x1\"" },
    { "tangential", SCENE_OWN, offsetof(struct node, tangential), .needed = true,
      .means = "d_t along the contact, likewise, or a list of one or two", .example = "\"x2\"" },
    { "area", SCENE_NUMBER, offsetof(struct node, area), "m^2", 0, SCENE_LARGE, .standard = 1,
      .means = "by which stiffnesses and preload are multiplied", .example = "1e-4" },
    { "normal_stiffness", SCENE_NUMBER, offsetof(struct node, normal_stiffness), "N/m^3", 0,
      HUGE_VAL, .standard = NAN, .otherwise = "the bed's", .means = "of this node",
      .example = "5000" },
    { "preload", SCENE_NUMBER, offsetof(struct node, preload), "N/m^2", -HUGE_VAL, HUGE_VAL,
      .standard = NAN, .otherwise = "the bed's", .means = "of this node", .example = "10" },
    { "tangential_stiffness", SCENE_NUMBER, offsetof(struct node, tangential_stiffness), "N/m^3",
      0, HUGE_VAL, .standard = NAN, .otherwise = "the bed's", .means = "of this node",
      .example = "4000" },
    { "mu", SCENE_NUMBER, offsetof(struct node, mu), "", 0, HUGE_VAL, .standard = NAN,
      .otherwise = "the bed's", .means = "of this node", .example = "0.3" },
    { 0 },
};

static const struct scene_key keys[] = {
    { "nodes", SCENE_LIST, offsetof(struct bed, nodes), "", 1, NODES_MOST, .needed = true,
      .members = node_keys, .means = "where it acts",
      .example = "[{\"normal\": \"x1\", \"tangential\": \"x2\"}]" },
    { "normal_stiffness", SCENE_NUMBER, offsetof(struct bed, normal_stiffness), "N/m^3", 0,
      HUGE_VAL, .needed = true, .means = "k_n of an area in N = area max(0, preload + k_n d_n)",
      .example = "5000" },
    { "preload", SCENE_NUMBER, offsetof(struct bed, preload), "N/m^2", -HUGE_VAL, HUGE_VAL,
      .means = "pressure at d_n = 0; < 0 is an open gap", .example = "10" },
    { "tangential_stiffness", SCENE_NUMBER, offsetof(struct bed, tangential_stiffness), "N/m^3", 0,
      HUGE_VAL, .needed = true, .means = "of an area of the springs before the sliders",
      .example = "4000" },
    { "mu", SCENE_NUMBER, offsetof(struct bed, mu), "", 0, HUGE_VAL, .needed = true,
      .means = "friction bound over momentary normal force", .example = "0.3" },
    { 0 },
};

/* OWN, unless the node has none. */
static double chosen(double own, double common) { return isnan(own) ? common : own; }

/* The tangential number I of a node at PATH, into *OUT. */
static enum modal_status read_tangential(const struct lowering *l, const cJSON *value,
                                         const char *path, int i, struct scene_ends *out,
                                         struct modal_error *err)
{
    char where[128], of[24];

    if (cJSON_IsArray(value))
        snprintf(of, sizeof of, "tangential[%d]", i);
    else
        strcpy(of, "tangential");
    json_path(where, path, of);
    return lowering_ends_of(l, cJSON_IsArray(value) ? cJSON_GetArrayItem(value, i) : value, where,
                            true, out, err);
}

/* The law of node N along AT: of its first tangential with the normal force, of the second
 * without. */
static enum modal_status add_law(struct lowering *l, const struct bed *s, const struct node *n,
                                 bool bears, struct scene_ends at, struct modal_error *err)
{
    double normal = n->area * chosen(n->normal_stiffness, s->normal_stiffness),
           preload = n->area * chosen(n->preload, s->preload),
           tangential = n->area * chosen(n->tangential_stiffness, s->tangential_stiffness),
           mu = chosen(n->mu, s->mu);
    struct law law;
    enum modal_status rc;

    if (normal == 0 && preload <= 0)                       /* never in contact: it leaves nothing */
        return MODAL_OK;
    rc = bears ? law_contact_friction(normal, preload, tangential, mu, &law, err)
               : law_contact_side(normal, preload, tangential, mu, &law, err);
    if (rc != MODAL_OK)
        return rc;
    lowering_place(l, &law, 0, n->normal);
    lowering_place(l, &law, 1, at);
    lowering_add_law(l, &law);
    return MODAL_OK;
}

/* The node ITEM at PATH. */
static enum modal_status add_node(struct lowering *l, const struct bed *s, const cJSON *item,
                                  const char *path, struct modal_error *err)
{
    static const struct scene_key *const tables[] = { node_keys, NULL };
    struct node n = { 0 };
    char where[128];
    enum modal_status rc = scene_keys_read(l, item, path, tables, &n, err);
    int count = rc == MODAL_OK && cJSON_IsArray(n.tangential)
                    ? cJSON_GetArraySize(n.tangential) : 1;

    json_path(where, path, "tangential");
    if (count < 1 || count > 2)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where, "%s has %d directions; accepted: one "
                              "or two", where, count);
    for (int i = 0; rc == MODAL_OK && i < count; i++) {
        struct scene_ends at = { 0 };

        rc = read_tangential(l, n.tangential, path, i, &at, err);
        if (rc == MODAL_OK)
            rc = add_law(l, s, &n, i == 0, at, err);
        free(at.x);
    }
    scene_keys_free(tables, &n);
    return rc;
}

static enum modal_status lower(struct lowering *l, const struct scene_effect *e,
                               struct modal_error *err)
{
    const struct bed *s = e->values;
    enum modal_status rc = MODAL_OK;
    const cJSON *item;
    char path[128];
    int i = 0;

    cJSON_ArrayForEach(item, s->nodes) {
        snprintf(path, sizeof path, "%s.nodes[%d]", e->path, i++);
        if (rc == MODAL_OK)
            rc = add_node(l, s, item, path, err);
    }
    return rc;
}

const struct scene_effect_kind effect_contact_bed = {
    .name = "contact_bed",
    .keys = { scene_type_keys, keys },
    .size = sizeof(struct bed),
    .law = "at each node minus N = area max(0, preload + normal_stiffness d_n) on normal; along "
           "each tangential minus a friction element of area tangential_stiffness whose limit is "
           "mu N: two are two sliders, their bound a square",
    .lower = lower,
};
