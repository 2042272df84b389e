/* compiled as C99 and as C11, and as C++17 through header_test.cc: palpate.h alone, without a warning */
#include "palpate.h"

int plp_header_compiles(void);
int plp_header_compiles(void) {
  plp_pose pose;
  return plp_pose_init(&pose, sizeof pose) == PLP_OK && plp_version() != 0 ? 0 : 1;
}
