/* keygen.c - `keygen FILE [SERVER-KEY]`: a new pair of CURVE keys; only the public key is
 * printed */
#include <stdio.h>
#include "outcome.h"
#include "wire/keyfile.h"
#include "verbs.h"

int run_keygen(const struct verb *verb, const struct args *args)
{
    struct modal_error err = { 0 };
    char public[41];
    cJSON *doc;
    enum modal_status rc = keyfile_make(args->word[1], args->words > 2 ? args->word[2] : NULL,
                                        public, &err);

    (void)verb;
    if (rc != MODAL_OK)
        return outcome_failure(args->json, &err, NULL);
    doc = cJSON_CreateObject();
    cJSON_AddStringToObject(doc, "file", args->word[1]);
    cJSON_AddStringToObject(doc, "public", public);
    if (args->json)
        outcome_json(doc, NULL);
    else
        printf("%s\n", public);
    cJSON_Delete(doc);
    return 0;
}
