/* scene_help.h - the language of scenes, told from the tables by which it is read (scene_key.h) */
#ifndef CTL_SCENE_HELP_H
#define CTL_SCENE_HELP_H
#include "verbs.h"

/*
 * Print every part that a scene may have, or those called TYPE (a structure's, effect's,
 * excitation's or sensor's type, or a list: "effects"), each with its law, its keys, their units,
 * ranges and defaults, and an example.  MODAL_BAD_INPUT, field "type": there is none; it lists
 * those that there are.
 */
enum modal_status scene_help(FILE *to, const char *type, struct modal_error *err);
#endif
