/* Adaptive hair for hosts in C and C++. Generated from adaptive-runtime-c; do not edit.
 *
 * Units: centimetre, gram, second, radian. Frames: `world`, and those of the head and of each solid, which a pose takes to
 * the world. Positions are float triples x, y, z, strand after strand, each from root to tip.
 *
 * Every call answers with a status; what went wrong is in words in ah_last_error(). Nothing here prints, ends the process
 * or lets an exception of the library through. A call that fails changes nothing, unless it answers AH_STATUS_PANICKED:
 * that is a defect of the library, and the hair it happened to can only be destroyed.
 *
 * Threads: one handle, one thread at a time; different handles may be used at the same time.
 *
 * Order: ah_model_load, ah_solid_*, ah_create; then, for each step, ah_set_*_pose and ah_step; ah_read when positions
 * are wanted, then ah_positions; ah_destroy.
 */

#ifndef ADAPTIVE_HAIR_H
#define ADAPTIVE_HAIR_H

#include <stddef.h>
#include <stdint.h>

// Version of this header, to compare with ah_version(): 10,000 x major + 100 x minor + patch.
#define AH_VERSION 100

// The whole method: hair splits around solids and pushes back on its guides.
#define AH_MODE_ADAPTIVE 0

// As AH_MODE_ADAPTIVE, but hair does not push back on its guides.
#define AH_MODE_NO_TWO_WAY 1

// Ordinary skinning: every hair keeps its guides, and only guides meet solids.
#define AH_MODE_FIXED 2

// The paper of 2016 to the letter, as far as parameters reach.
#define AH_MODE_PAPER 3

// Most stages a step may consist of.
#define AH_MAX_STAGES 16

// How a call went.
enum AhStatus
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // As asked.
    AH_STATUS_OK = 0,
    // An argument is null or out of range; nothing has changed.
    AH_STATUS_BAD_ARGUMENT = 1,
    // The file is not there, damaged, or no skinning model of this version.
    AH_STATUS_BAD_MODEL = 2,
    // The shape or mesh encloses nothing, or its grid would be too large.
    AH_STATUS_BAD_SOLID = 3,
    // The model's guides cannot be simulated, or a parameter is out of range.
    AH_STATUS_CANNOT_CREATE = 4,
    // Worker threads could not be started.
    AH_STATUS_NO_THREADS = 5,
    // A defect of the library, caught; the hair it happened to is broken.
    AH_STATUS_PANICKED = 6,
    // The hair met a defect before; it can only be destroyed.
    AH_STATUS_BROKEN = 7,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum AhStatus AhStatus;
#else
typedef int32_t AhStatus;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// The hair of one head, in motion among solids.
typedef struct AhHair AhHair;

// A trained skinning model.
typedef struct AhModel AhModel;

// A solid in its own frame, baked.
typedef struct AhSolid AhSolid;

// A rod with round ends.
typedef struct AhRod {
    // One end of its axis, cm, solid's frame.
    float a[3];
    // The other end; the same as `a` for a ball.
    float b[3];
    // cm.
    float radius;
} AhRod;

// How hair behaves; fill with ah_params_default and change what you like.
typedef struct AhParams {
    // One of AH_MODE_*.
    uint32_t mode;
    // Whether hair pushes back on its guides; 0 is no, anything else yes.
    uint32_t two_way;
    // Whether hairs near solids are corrected one by one. Without it, hair between guides passes through thin solids.
    uint32_t residual;
    // Whether hairs keep apart from each other in what is read; a read then costs several times as much.
    uint32_t hair_hair;
    // Worker threads of this hair; 0 for one a core. Results do not depend on it.
    uint32_t n_threads;
} AhParams;

// Where a head or a solid is: a point p of it is at rotation p + translation in the world.
typedef struct AhPose {
    // cm.
    double translation[3];
    // Unit quaternion x, y, z, w.
    double rotation[4];
} AhPose;

// What a step met.
typedef struct AhReport {
    // Contacts of guide segments with solids.
    uint64_t guide_contacts;
    // Hairs corrected one by one.
    uint32_t corrected_strands;
    // Hairs in contact with a solid.
    uint32_t strands_in_contact;
    // Guides that hairs push.
    uint32_t guides_pushed;
    // Hairs that follow other guides than before.
    uint32_t set_changes;
    // Hairs put back because their state was not finite: 0 unless something is wrong.
    uint32_t quarantined;
    // Stages in stage_s.
    uint32_t n_stages;
    // Share of guide pairs that may be blended, 0 to 1.
    double connectivity;
    // Deepest that a hair is left in a solid where it was looked at, cm; 0 for none.
    double deepest_cm;
    // Wall time of each stage, s; their names are ah_stage_name(0) and so on.
    double stage_s[AH_MAX_STAGES];
} AhReport;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Version of the library: 10,000 x major + 100 x minor + patch. Structs are laid out as in the header if it is AH_VERSION.
uint32_t ah_version(void);

// What went wrong in the last call on this thread that failed, in English; never null, valid until the next that fails.
const char *ah_last_error(void);

// Loads a skinning model, as `cargo xtask train` writes it. `path` is UTF-8. Free it with ah_model_free.
AhStatus ah_model_load(const char *path, struct AhModel **out);

// Frees a model; null is allowed. Hair made from it keeps its own copy.
void ah_model_free(struct AhModel *model);

// A ball about `center` (x, y, z) in the solid's frame. `friction` is Coulomb's coefficient; `cell_cm` the resolution of its
// distance field, 0 to choose. Free it with ah_solid_free.
AhStatus ah_solid_sphere(const float *center,
                         float radius_cm,
                         float friction,
                         float cell_cm,
                         struct AhSolid **out);

// The union of rods with round ends, such as one tooth or a whole comb; the rest as ah_solid_sphere.
AhStatus ah_solid_rods(const struct AhRod *rods, size_t n_rods, float friction, float cell_cm, struct AhSolid **out);

// A triangle mesh: `positions` are 3 `n_vertices` coordinates (cm, solid's frame), `triangles` 3 `n_triangles` indices of
// vertices. It may have holes and overlap itself, but must have an inside; a cell_cm of 0 takes a quarter of its
// thinnest feature. Baking may take seconds. The rest as ah_solid_sphere.
AhStatus ah_solid_mesh(const float *positions,
                       size_t n_vertices,
                       const uint32_t *triangles,
                       size_t n_triangles,
                       float friction,
                       float cell_cm,
                       struct AhSolid **out);

// Frees a solid; null is allowed. Hair made with it keeps its own copy.
void ah_solid_free(struct AhSolid *solid);

// Fills `out` with the parameters of a mode, one of AH_MODE_*.
AhStatus ah_params_default(uint32_t mode, struct AhParams *out);

// Fills `out` with the pose of a matrix [R | t], 3 rows of 4 numbers, row after row, that takes column vectors to the world.
// It must be rigid: no scale, no mirror.
AhStatus ah_pose_from_matrix(const float *rows,
                             struct AhPose *out);

// Hair at rest on a head at the given pose. Model and solids are copied. `head` is the head and body in the head's frame, or
// null for none; `solids` and `solid_poses` are `n_solids` each, in the order by which solids are named from then on, and
// may be null if there are none. Destroy it with ah_destroy.
AhStatus ah_create(const struct AhModel *model,
                   const struct AhParams *params,
                   const struct AhPose *head_pose,
                   const struct AhSolid *head,
                   const struct AhSolid *const *solids,
                   const struct AhPose *solid_poses,
                   size_t n_solids,
                   struct AhHair **out);

// Destroys hair and with it its positions; null is allowed.
void ah_destroy(struct AhHair *hair);

// Where the head is at the end of the next step; it stays there until it is set again.
AhStatus ah_set_head_pose(struct AhHair *hair, const struct AhPose *pose);

// Where a solid is at the end of the next step; it stays there until it is set again.
AhStatus ah_set_solid_pose(struct AhHair *hair, uint32_t solid, const struct AhPose *pose);

// Puts the head elsewhere at once, with all its hair as it is: for a head that jumps, which a step would have tear at its hair.
AhStatus ah_put_head(struct AhHair *hair,
                     const struct AhPose *pose);

// Puts a solid elsewhere at once: for one that appears, leaves or jumps, which a step would sweep through all hair on its way.
AhStatus ah_put_solid(struct AhHair *hair,
                      uint32_t solid,
                      const struct AhPose *pose);

// Advances the hair by `dt_s` seconds (0.01 is what it is made for) to the poses set. `report` may be null.
AhStatus ah_step(struct AhHair *hair, double dt_s, struct AhReport *report);

// Brings the positions of all hair up to date with the last step. Needed only when they are wanted: hair does not move
// otherwise for being read more often or less.
AhStatus ah_read(struct AhHair *hair);

// Positions in the world as of the last ah_read, cm: ah_n_strands x ah_n_particles x 3 floats, strand after strand, each from
// root to tip. Valid until the next ah_read or ah_destroy. Null on failure.
const float *ah_positions(const struct AhHair *hair);

// Positions as of the ah_read before that, for motion blur; otherwise as ah_positions.
const float *ah_previous_positions(const struct AhHair *hair);

// Strands; 0 on failure.
size_t ah_n_strands(const struct AhHair *hair);

// Particles of each strand; 0 on failure.
size_t ah_n_particles(const struct AhHair *hair);

// Guides among the strands; 0 on failure.
size_t ah_n_guides(const struct AhHair *hair);

// Solids the hair was created with; 0 on failure.
size_t ah_n_solids(const struct AhHair *hair);

// Name of a stage of AhReport; null past the last.
const char *ah_stage_name(uint32_t stage);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* ADAPTIVE_HAIR_H */
