/* scene_file.h - a scene as a file: strict JSON, with `structure.file` (HDF5) read and put in its
 * place */
#ifndef CTL_SCENE_FILE_H
#define CTL_SCENE_FILE_H
#include "base/error.h"
#include "base/json.h"

enum {
    SCENE_TEXT_MOST = 64 << 20,      /* bytes: what a daemon takes in one body */
    SCENE_MATRIX_MOST = 100000       /* rows: dense beyond 80 GB, sparse beyond what is factored */
};

/*
 * Read the scene at PATH ("-": stdin); the caller frees *OUT.  `structure.file`, relative to the
 * scene's folder, has datasets M, K, C, G: each n x n, or a group of CSR arrays `data`, `indices`,
 * `indptr` as scipy writes them.  They replace the key "file" in the form that modal/scene/scene.h
 * reads; so do Matrix Market files that M, K, C or G name.  Of a sweep's file the scene in it is
 * meant.  MODAL_BAD_INPUT with the path of what is wrong: a missing file ("file"), JSON,
 * `structure.file`, `structure.M`.
 */
enum modal_status scene_file_read(const char *path, cJSON **out, struct modal_error *err);

#endif
