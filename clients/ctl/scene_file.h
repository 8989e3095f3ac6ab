/* scene_file.h - a scene as a file: strict JSON, with `structure.file` (HDF5) read and put in its
 * place */
#ifndef CTL_SCENE_FILE_H
#define CTL_SCENE_FILE_H
#include "base/error.h"
#include "base/json.h"
#include "modal/scene/scene_arrays.h"

enum {
    SCENE_TEXT_MOST = 64 << 20       /* bytes: what a daemon takes in one body */
};

/*
 * Read the scene at PATH ("-": stdin); the caller frees *OUT.  `structure.file`, relative to the
 * scene's folder, has datasets M, K, C, G: each n x n, or a group of CSR arrays `data`, `indices`,
 * `indptr` as scipy writes them.  They go into ARRAYS, which the caller frees, and what names them
 * there replaces the key "file"; so do Matrix Market files that M, K, C or G name.  Of a sweep's
 * file the scene in it is meant.  MODAL_BAD_INPUT with the path of what is wrong: a missing file
 * ("file"), JSON, `structure.file`, `structure.M`.
 */
enum modal_status scene_file_read(const char *path, cJSON **out, struct scene_arrays_made *arrays,
                                  struct modal_error *err);

#endif
