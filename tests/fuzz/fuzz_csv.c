/* fuzz_csv.c - a user's text is read into finite shapes, or refused with a reason: as a file, and
 * row by row from a pipe */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>
#include "ctl/csv.h"
#include "ctl/rows.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void read_rows(const uint8_t *data, size_t size, const struct signals_options *options)
{
    struct signals head = { 0 };
    struct modal_error err = { 0 };
    struct rows *rows = NULL;
    enum rows_state state = ROWS_ROW;
    int fd = memfd_create("rows", MFD_CLOEXEC);

    if (fd < 0 || write(fd, data, size) != (ssize_t)size || lseek(fd, 0, SEEK_SET) != 0)
        abort();
    enum modal_status rc = rows_open(fd, "f.csv", options, &rows, &head, &err);
    double *x = calloc(head.channels + 1, sizeof *x);
    if (rc == MODAL_OK && (head.samples == 0 || head.channels == 0 || !(head.dt > 0) || x == NULL))
        abort();
    while (rc == MODAL_OK && state != ROWS_END)
        rc = rows_next(rows, x, -1, &state, &err);
    if (rc != MODAL_OK && err.message[0] == '\0')
        abort();
    free(x);
    rows_close(rows);
    signals_done(&head);
    close(fd);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct signals signals = { 0 };
    struct modal_error err = { 0 };
    struct signals_options options = { .dt = size % 2 ? 0.01 : 0, .ignore_time = size % 3 == 0 };
    char *text = malloc(size + 1);

    if (text == NULL)
        return 0;
    memcpy(text, data, size);
    text[size] = '\0';
    enum modal_status rc = csv_read(text, "f.csv", &options, &signals, NULL, &err);
    if (rc == MODAL_OK) {
        double sum = 0;
        for (size_t i = 0; i < signals.samples * signals.channels; i++)
            sum += signals.x[i];
        if (signals.samples == 0 || signals.channels == 0 || !(signals.dt >= 0) ||
            (sum == 0 && signals.x == NULL))
            abort();
    } else if (err.message[0] == '\0') {
        abort();
    }
    signals_done(&signals);
    free(text);
    read_rows(data, size, &options);
    return 0;
}
