#include <dlfcn.h>
#include <gtest/gtest.h>
#include <pthread.h>
#include <unistd.h>

#include <atomic>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <new>

#include "haptics/test_model.h"
#include "palpate/servo.h"

/// The proof that a tick allocates nothing, locks nothing and writes nothing: the functions it would
/// have to call are replaced here by counting ones.
namespace {

std::atomic<long> allocations{0};
std::atomic<long> locks{0};
std::atomic<long> writes{0};

template <class Function>
Function next(const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}

}  // namespace

// the compiler cannot know that these new and delete belong together
#pragma GCC diagnostic ignored "-Wmismatched-new-delete"

void* operator new(std::size_t size) {
  ++allocations;
  if (void* p = std::malloc(size)) return p;
  throw std::bad_alloc();
}
void* operator new(std::size_t size, std::align_val_t alignment) {
  ++allocations;
  const std::size_t a = static_cast<std::size_t>(alignment);
  if (void* p = std::aligned_alloc(a, (size + a - 1) / a * a)) return p;
  throw std::bad_alloc();
}
void operator delete(void* p) noexcept {
  std::free(p);
}
void operator delete(void* p, std::size_t) noexcept {
  std::free(p);
}
void operator delete(void* p, std::align_val_t) noexcept {
  std::free(p);
}
void operator delete(void* p, std::size_t, std::align_val_t) noexcept {
  std::free(p);
}

extern "C" int pthread_mutex_lock(pthread_mutex_t* mutex) noexcept {
  ++locks;
  static const auto real = next<int (*)(pthread_mutex_t*)>("pthread_mutex_lock");
  return real(mutex);
}
extern "C" ssize_t write(int fd, const void* data, std::size_t size) {
  ++writes;
  static const auto real = next<ssize_t (*)(int, const void*, std::size_t)>("write");
  return real(fd, data, size);
}

namespace palpate {
namespace {

TEST(Realtime, TheCountersCount) {
  // without this the proof below could pass because nothing is counted
  const long allocated = allocations, locked = locks, written = writes;
  auto number = std::make_unique<int>(3);
  EXPECT_EQ(allocations - allocated, 1);
  std::mutex mutex;
  mutex.lock();
  mutex.unlock();
  EXPECT_EQ(locks - locked, 1);
  EXPECT_EQ(::write(STDOUT_FILENO, "", 0), 0);
  EXPECT_EQ(writes - written, 1);
  EXPECT_EQ(*number, 3);
}

TEST(Realtime, TenThousandTicksAllocateLockAndWriteNothing) {
  const Model model = testing::ball_model({1, 1, 1}, 1.0, 3);
  Parameters parameters;
  SessionState state;
  TickRecord record;
  std::array<DeviceState, 2> devices;
  std::array<Wrench, 2> wrenches;
  const auto run = [&](int ticks) {
    for (int n = 0; n < ticks; ++n) {
      // in and out of contact, deep inside, outside, not finite, turning, clamped, paused
      const double r = 15 + 20 * std::sin(0.003 * n);
      devices[0].tip = Point<World>(r * std::cos(0.01 * n), r * std::sin(0.01 * n), 0);
      devices[1].tip = Point<World>(0, n % 50 == 0 ? std::nan("") : 16.0, 0.001 * n);
      if (n % 100 == 0)
        parameters.rotation_target = Eigen::Quaterniond(std::cos(1e-4 * n), 0, std::sin(1e-4 * n), 0);
      parameters.paused = n % 1000 > 950;
      parameters.max_force_N = n % 3 == 0 ? 0.5 : 3;
      tick(model, parameters, devices, 1e-3, state, wrenches, record);
    }
  };
  run(100);
  const long allocated = allocations, locked = locks, written = writes;
  run(10000);
  const long allocated_after = allocations, locked_after = locks, written_after = writes;
  EXPECT_EQ(allocated_after - allocated, 0);
  EXPECT_EQ(locked_after - locked, 0);
  EXPECT_EQ(written_after - written, 0);
}

}  // namespace
}  // namespace palpate
