/* sound.c - see sound.h */
#include "sound.h"
#include <sndfile.h>
#include <stdlib.h>
#include <string.h>

static enum modal_status check(const SF_INFO *info, const char *path, struct modal_error *err)
{
    if (info->channels < 1 || info->samplerate < 1 || info->frames < 1)
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals", "%s: no samples", path);
    if ((size_t)info->frames > SIGNALS_VALUES_MOST / (size_t)info->channels)
        return modal_fail_field(err, MODAL_TOO_LARGE, "signals", "%s: more than %zu values", path,
                                SIGNALS_VALUES_MOST);
    return MODAL_OK;
}

bool sound_is(const unsigned char *head, size_t length)
{
    static const char *const magic[] = { "RIFF", "RF64", "fLaC", "FORM", "OggS" };

    for (size_t i = 0; i < sizeof magic / sizeof *magic; i++)
        if (length >= strlen(magic[i]) && memcmp(head, magic[i], strlen(magic[i])) == 0)
            return true;
    return false;
}

enum modal_status sound_read(const char *path, const struct signals_options *options,
                             struct signals *out, struct modal_error *err)
{
    SF_INFO info = { 0 };
    SNDFILE *file = sf_open(path, SFM_READ, &info);
    enum modal_status rc;

    (void)options;
    if (file == NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals", "%s: %s", path, sf_strerror(NULL));
    rc = check(&info, path, err);
    if (rc == MODAL_OK
        && (out->x = malloc((size_t)info.frames * (size_t)info.channels * sizeof *out->x)) == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "%s: no memory for %lld samples", path,
                        (long long)info.frames);
    if (rc == MODAL_OK && sf_readf_double(file, out->x, info.frames) != info.frames)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "signals",
                              "%s: cut short: %lld samples announced", path,
                              (long long)info.frames);
    if (rc == MODAL_OK) {
        out->samples = (size_t)info.frames;
        out->channels = (size_t)info.channels;
        out->dt = 1.0 / info.samplerate;
        out->dt_off = SIGNALS_DT_OFF * out->dt;
        out->dt_from = "its sampling rate";
    }
    sf_close(file);
    return rc;
}
