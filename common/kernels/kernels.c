/* All numeric kernels as one unit; none of the files is compiled alone. Rounding is that of Python's floats:
   -ffp-contract=off and no fast math. How they are built and debugged: docs/how-to/kernels.md. */
#include <string.h>
#include "state.h"
#include "numbers.h"
#include "bank.c"
#include "forces.c"
#include "change_detection.c"
#include "band.c"
#include "blend.c"
#include "experts.c"
#include "evaluator.c"
#include "learner.c"
#include "loops.c"
#include "path_force.c"
#include "unit_tests.c"

/* Digest of the sources that this was built from. */
const char *kernels_sources_sha256(void) { return SOURCES_SHA256; }

/* Size of the record of that name in bytes; 0 if there is none. */
long kernels_record_size(const char *name) {
    for (unsigned i = 0; i < sizeof RECORDS / sizeof *RECORDS; i++)
        if (strcmp(RECORDS[i].name, name) == 0)
            return RECORDS[i].size;
    return 0;
}
