/* tradeoff.c - see tradeoff.h; tested by tests/unit/job/test_tradeoff_identify.c */
#include "job/tradeoff.h"
#include "base/near.h"
#include "job/tradeoff_identify.h"
#include "job/tradeoff_simulate.h"
#include "job/tradeoff_steady.h"
#include <stdio.h>
#include <string.h>

/* What can be traded off: each a file tradeoff_*.c of this folder. */
static const struct tradeoff {
    const char *of;
    bool on_scene;
    enum modal_status (*run)(const struct job_request *, struct job_result *, struct modal_error *);
} tradeoffs[] = {
    { "identify", false, tradeoff_identify },
    { "steady", true, tradeoff_steady },
    { "simulate", true, tradeoff_simulate },
    { NULL, false, NULL },
};

static enum modal_status refuse(const char *of, bool on_scene, struct modal_error *err)
{
    const char *names[sizeof tradeoffs / sizeof *tradeoffs];
    char list[NEAR_ACCEPTED];
    int count = 0;

    for (const struct tradeoff *t = tradeoffs; t->of != NULL; t++)
        if (t->on_scene == on_scene)
            names[count++] = t->of;
    names[count] = NULL;
    near_accepted(of, names, list);
    return modal_fail_field(err, MODAL_BAD_INPUT, "of",
                            "cannot trade off \"%.40s\" on a %s%s", of,
                            on_scene ? "scene" : "batch", list);
}

enum modal_status tradeoff_run(const struct job_request *request, struct job_result *out,
                               struct modal_error *err)
{
    bool on_scene = request->batch == NULL;
    const char *of = on_scene ? "steady" : "identify";
    enum modal_status rc = json_get_string(request->options, "", "of", &of, err);

    if (rc != MODAL_OK)
        return rc;
    for (const struct tradeoff *t = tradeoffs; t->of != NULL; t++)
        if (t->on_scene == on_scene && strcmp(t->of, of) == 0)
            return t->run(request, out, err);
    return refuse(of, on_scene, err);
}
