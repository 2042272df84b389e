#include "apps/palpate/verbs.h"

// The verbs as a C function, which cli.py calls in its own process. Descriptors stay open.
extern "C" int palpate_run(int count, const char* const* arguments, int in, int out, int err) {
  return palpate::app::run({arguments, arguments + count}, {in, out, err});
}
