/* A plug-in for tests: an arm on a spring, pushed 2 mm in x, or with PALPATE_TEST_PLUGIN "press" moved down from 60 mm above
   the middle to 20 mm below it in a second. Otherwise PALPATE_TEST_PLUGIN is what goes wrong: nothing; in loading "fails",
   "count", "axes" or "moves"; in connecting "absent"; after half a second of reads "crash", "hang", "nan", "size", "exit" or "read".
   The force that acts is in the file PALPATE_TEST_PLUGIN_FORCE, as a double. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "palpate_driver.h"

enum { kReadsBeforeFault = 500 };
static const char* mode;
static volatile double* acting_N;
static int reads;
static volatile uintptr_t nowhere;

static int is_mode(const char* name) {
  return strcmp(mode, name) == 0;
}

static int32_t open_arm(void* context, int32_t may_move, plp_driver_device* devices, char* error,
                        uint32_t error_size) {
  (void)context;
  (void)may_move;
  if (is_mode("absent")) {
    strncpy(error, "no arm answers on the bus", error_size - 1);
    return -1;
  }
  strcpy(devices[0].name, "Test arm no. 7");
  return 0;
}

static int32_t read_arm(void* context, plp_driver_sample* samples) {
  (void)context;
  ++reads;
  samples[0].tip_mm[0] = -2 - *acting_N;
  samples[0].buttons = 1;
  if (is_mode("press")) samples[0].tip_mm[2] = 60 - 0.08 * (reads < 1000 ? reads : 1000);
  if (reads < kReadsBeforeFault) return 0;
  /* not raise(): the signal is blocked on this thread, and what the processor reports is not */
  if (is_mode("crash")) *(volatile int*)nowhere = 1;
  if (is_mode("exit")) _exit(3);
  if (is_mode("nan")) samples[0].tip_mm[1] = NAN;
  if (is_mode("size")) samples[0].size = 8;
  while (is_mode("hang")) usleep(1000);
  return is_mode("read") && reads < 2 * kReadsBeforeFault ? -1 : 0;
}

static int32_t write_arm(void* context, const plp_driver_command* commands) {
  (void)context;
  *acting_N = commands[0].force_N[0];
  return 0;
}

static void halt_arm(void* context) {
  (void)context;
  *acting_N = 0;
}

static void close_arm(void* context) {
  (void)context;
  *acting_N = 0;
}

PLP_DRIVER_EXPORT int32_t plp_driver_v1(plp_driver* driver) {
  const char* const file = getenv("PALPATE_TEST_PLUGIN_FORCE");
  static double initial_N;
  acting_N = &initial_N;
  mode = getenv("PALPATE_TEST_PLUGIN");
  if (mode == NULL) mode = "";
  if (is_mode("fails")) return -1;
  if (file != NULL) {
    const int open_file = open(file, O_RDWR | O_CLOEXEC);
    void* const memory = mmap(NULL, sizeof(double), PROT_READ | PROT_WRITE, MAP_SHARED, open_file, 0);
    if (memory == MAP_FAILED) return -1;
    acting_N = memory;
  }
  driver->device_count = is_mode("count") ? 9 : 1;
  driver->devices[0].peak_force_N = 3;
  driver->devices[0].stiffness_N_per_mm = 2;
  driver->devices[0].buttons = 1;
  driver->devices[0].moves_by_itself = is_mode("moves");
  if (is_mode("axes")) driver->devices[0].axes[0] = 2;
  driver->open = open_arm;
  driver->read = read_arm;
  driver->write = write_arm;
  driver->halt = halt_arm;
  driver->close = close_arm;
  return 0;
}
