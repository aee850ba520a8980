/* A host in C: loads the model named on the command line, moves a head and a ball through its hair, and prints a hash of
 * where all hair is. Any answer it does not expect ends it with the line it happened in. */

#include "adaptive_hair.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define EXPECT(condition)                                                                                              \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            fprintf(stderr, "line %d: %s; last error: %s\n", __LINE__, #condition, ah_last_error());                   \
            return 1;                                                                                                  \
        }                                                                                                              \
    } while (0)

/* FNV-1a over the bits of n floats. */
static uint64_t hash_of(const float *x, size_t n)
{
    uint64_t hash = 0xcbf29ce484222325u;
    for (size_t k = 0; k < n; ++k) {
        uint32_t bits;
        memcpy(&bits, x + k, sizeof bits);
        hash = (hash ^ bits) * 0x100000001b3u;
    }
    return hash;
}

static AhPose pose_at(double x, double y, double z)
{
    AhPose pose = {{x, y, z}, {0.0, 0.0, 0.0, 1.0}};
    return pose;
}

int main(int argc, char **argv)
{
    EXPECT(argc == 2);
    EXPECT(ah_version() == AH_VERSION);
    EXPECT(strcmp(ah_last_error(), "") == 0);

    AhModel *model = NULL;
    EXPECT(ah_model_load("no such file", &model) == AH_STATUS_BAD_MODEL && model == NULL);
    EXPECT(strstr(ah_last_error(), "no such file") != NULL);
    EXPECT(ah_model_load(argv[1], &model) == AH_STATUS_OK);

    AhSolid *ball = NULL, *tooth = NULL;
    const float center[3] = {0.0f, 0.0f, 0.0f};
    const AhRod rod = {{0.0f, 0.0f, -2.0f}, {0.0f, 0.0f, 2.0f}, 0.2f};
    EXPECT(ah_solid_sphere(center, 1.5f, 0.3f, 0.0f, &ball) == AH_STATUS_OK);
    EXPECT(ah_solid_rods(&rod, 1, 0.3f, 0.0f, &tooth) == AH_STATUS_OK);
    const AhSolid *solids[2] = {ball, tooth};
    AhPose poses[2] = {pose_at(0.5, -8.0, -3.0), pose_at(1.5, -5.0, -4.0)};

    AhParams params;
    AhHair *hair = NULL;
    AhPose head = pose_at(0.0, 0.0, 0.0);
    EXPECT(ah_params_default(AH_MODE_ADAPTIVE, &params) == AH_STATUS_OK);
    params.n_threads = 2;
    EXPECT(ah_create(model, &params, &head, NULL, solids, poses, 2, &hair) == AH_STATUS_OK);
    /* The hair has copies. */
    ah_solid_free(tooth);
    ah_solid_free(ball);
    ah_model_free(model);

    AhReport report;
    uint32_t most_in_contact = 0;
    for (int step = 1; step <= 40; ++step) {
        head = pose_at(0.01 * step, 0.0, 0.0);
        poses[0] = pose_at(0.5, -8.0, -3.0 + 0.1 * step);
        EXPECT(ah_set_head_pose(hair, &head) == AH_STATUS_OK);
        EXPECT(ah_set_solid_pose(hair, 0, &poses[0]) == AH_STATUS_OK);
        EXPECT(ah_set_solid_pose(hair, 2, &poses[0]) == AH_STATUS_BAD_ARGUMENT);
        EXPECT(ah_step(hair, 0.01, &report) == AH_STATUS_OK);
        EXPECT(report.quarantined == 0 && report.n_stages > 0 && ah_stage_name(report.n_stages) == NULL);
        if (report.strands_in_contact > most_in_contact)
            most_in_contact = report.strands_in_contact;
    }
    EXPECT(ah_step(hair, -1.0, NULL) == AH_STATUS_BAD_ARGUMENT);
    EXPECT(ah_read(hair) == AH_STATUS_OK);

    const size_t n_strands = ah_n_strands(hair), n_particles = ah_n_particles(hair);
    const size_t n = 3 * n_strands * n_particles;
    const float *now = ah_positions(hair), *before = ah_previous_positions(hair);
    EXPECT(n_strands > 0 && n_particles > 0 && ah_n_guides(hair) > 0 && ah_n_solids(hair) == 2);
    EXPECT(now != NULL && before != NULL && now != before);
    for (size_t k = 0; k < n; ++k)
        EXPECT(isfinite(now[k]) && isfinite(before[k]));

    printf("%zu %zu %u %016llx\n", n_strands, n_particles, most_in_contact, (unsigned long long)hash_of(now, n));
    ah_destroy(hair);
    return 0;
}
