#include <dlfcn.h>
#include <gtest/gtest.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <pthread.h>
#include <stddef.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <memory>
#include <mutex>

#include "contact/test_model.h"
#include "palpate/device/simulated_device.h"
#include "palpate/servo/servo.h"
#include "palpate/tissue/carving.h"
#include "servo/loop.h"

/// Proof that a tick does not allocate, lock or make system calls: allocations and mutexes are counted by
/// interposed functions, and the ticks run again in a child process that the kernel kills at its first system
/// call.

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
extern "C" int __sanitizer_install_malloc_and_free_hooks(void (*)(const volatile void*, size_t),
                                                         void (*)(const volatile void*));
#endif

namespace {

std::atomic<long> allocations{0}, frees{0};
std::atomic<long> locks{0};

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
// the sanitizer owns malloc and reports every call
[[maybe_unused]] const int hooked = __sanitizer_install_malloc_and_free_hooks(
    [](const volatile void*, size_t) { ++allocations; }, [](const volatile void*) { ++frees; });
#endif

}  // namespace

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
extern "C" {
void* __libc_malloc(size_t size);
void* __libc_calloc(size_t count, size_t size);
void* __libc_realloc(void* old, size_t size);
void* __libc_memalign(size_t alignment, size_t size);
void __libc_free(void* old);

void* malloc(size_t size) {
  ++allocations;
  return __libc_malloc(size);
}
void* calloc(size_t count, size_t size) {
  ++allocations;
  return __libc_calloc(count, size);
}
void* realloc(void* old, size_t size) {
  ++allocations;
  return __libc_realloc(old, size);
}
void* aligned_alloc(size_t alignment, size_t size) {
  ++allocations;
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** room, size_t alignment, size_t size) {
  ++allocations;
  *room = __libc_memalign(alignment, size);
  return *room == nullptr ? ENOMEM : 0;
}
void free(void* old) {
  ++frees;
  __libc_free(old);
}
}
#endif

// ThreadSanitizer intercepts mutexes itself
#if !defined(__SANITIZE_THREAD__)
template <class Lock>
int counted(const char* name, Lock* lock) {
  ++locks;
  return reinterpret_cast<int (*)(Lock*)>(dlsym(RTLD_NEXT, name))(lock);
}
extern "C" {
int pthread_mutex_lock(pthread_mutex_t* mutex) noexcept {
  return counted("pthread_mutex_lock", mutex);
}
int pthread_mutex_trylock(pthread_mutex_t* mutex) noexcept {
  return counted("pthread_mutex_trylock", mutex);
}
int pthread_rwlock_rdlock(pthread_rwlock_t* lock) noexcept {
  return counted("pthread_rwlock_rdlock", lock);
}
int pthread_rwlock_wrlock(pthread_rwlock_t* lock) noexcept {
  return counted("pthread_rwlock_wrlock", lock);
}
}
#endif

namespace palpate {
namespace {

// the ball among many small ones, and a large tool of four spheres
Model crowded_model() {
  constexpr std::size_t kStructures = 250;
  Model model = testing::as_one_body(testing::with_every_method(testing::ball_model({1, 1, 1}, 1.0, 3)), 3);
  model.surfaces.back().opened_by = {1};
  for (std::size_t n = 0; model.surfaces.size() < kStructures; ++n) {
    const double turn = 0.7 * static_cast<double>(n), up_mm = 0.2 * static_cast<double>(n) - 25;
    const Eigen::Vector3d centre(30 * std::cos(turn), 30 * std::sin(turn), up_mm);
    GridGeometry grid = testing::cube_grid(5, {1, 1, 1});
    grid.origin += Vector<Patient>(centre);
    model.surfaces.push_back(testing::make_contact_surface(
        grid, [&](const Eigen::Vector3d& p) { return (p - centre).norm() - 2; }, 2));
    model.surfaces.back().structure = 0;
  }
  // distances to some of the small ones are reported, and some are no-go regions
  constexpr std::size_t kFirst = 3, kTracked = 10;
  std::vector<TrackedStructure> tracked;
  for (std::size_t n = kFirst; n < kFirst + kTracked; ++n)
    tracked.push_back(
        {static_cast<LabelId>(n + 1), std::make_shared<const SurfaceTree>(model.surfaces[n].surface), true});
  model.distance_trees = {std::move(tracked), 30};
  model.no_go = {{"structure", NoGoStructure{4, 0}, 2, 1},
                 {"plane", NoGoPlane{{0, 0, -10}, {0, 0, 1}}, 5, 3},
                 {"ball", NoGoSphere{{20, 0, 0}, 4}, 3, 0.5}};
  // the shell around the ball is deformable, and punctures stay open
  model.tissue_law = TissueLaw::kElastic;
  model.surfaces[1].plane_strain_modulus_N_per_mm2 = 0.02;
  model.surfaces[1].puncture_N = 0.3;
  model.surfaces[1].stays_open = true;
  constexpr Relaxation kRelaxation{{{{0.3, 0.1}, {0.2, 3}}}};
  model.relaxation_times.add(kRelaxation);
  model.surfaces[1].relaxed.add(kRelaxation, model.relaxation_times, 1);
  model.tools[0].points_mm = {{0, 0, 0}, {5, 0, 0}};
  model.tools[0].capsules = {{{0, 5, 0}, {0, 5, 20}, 1}, {{0, 0, 0}, {0, 0, 40}, 0.5}};
  return model;
}

// two devices moved in and out of contact, deep inside, outside, with non-finite poses and rotations, clamped
// and paused, rotated slowly and faster than a tick follows, by every force method
class Exercise {
 public:
  void run(int ticks) {
    for (int n = 0; n < ticks; ++n) {
      const double r = 15 + 20 * std::sin(0.003 * n);
      devices_[0].tip = Point<World>(r * std::cos(0.01 * n), r * std::sin(0.01 * n), 0);
      devices_[1].tip = Point<World>(0, n % 50 == 0 ? std::nan("") : 16.0, 0.001 * n);
      const double turn = n % 2000 < 1000 ? 0.005 * n : 0.3 * n;
      devices_[0].R_WorldTool = Eigen::AngleAxisd(turn, Eigen::Vector3d(0.6, 0, 0.8));
      if (n % 100 == 0)
        parameters_.rotation_target = Eigen::Quaterniond(std::cos(1e-4 * n), 0, std::sin(1e-4 * n), 0);
      if (n % 700 == 0) parameters_.rotation_target = Eigen::Quaterniond(0, 1e200, 0, 0);
      if (n % 900 == 0) parameters_.rotation_target = Eigen::Quaterniond(std::nan(""), 0, 0, 0);
      parameters_.paused = n % 1000 > 950;
      parameters_.max_force_N = n % 3 == 0 ? 0.5 : 3;
      if (n % 40 == 0) parameters_.method = next_of(parameters_.method);
      // occasionally it switches to another law under the tool for a while
      if (n % 110 == 95 || n % 110 == 109) {
        ++model_.version;
        model_.tissue_law = n % 110 == 95 ? TissueLaw::kLayers : TissueLaw::kElastic;
        if (state_.device[0].proxy.contact_count > 0 || state_.device[1].proxy.contact_count > 0)
          ++law_changes_;
      }
      if (n % 16 == 0) {
        ComplianceFrame& frame = parameters_.compliance;
        ++frame.number;
        frame.local_compliance[0] = {
            Point<Patient>(18, 0, 0), n % 160 == 0 ? 0 : 10.0 + n % 5, {0.1, 0, 0.2}, 0.02, 3};
        frame.local_compliance[0].relaxed.of_time = {0.2, 0.001 * (n % 200)};
      }
      // in one tick of eight, because they take longer than everything else
      if (n % 8 < 2) {
        std::swap(model_.distance_trees, distances_);
        std::swap(model_.no_go, no_go_);
      }
      tick(model_, parameters_, devices_, 1e-3, state_, wrenches_, record_);
      if (state_.device[0].proxy.compliance.modulus_N_per_mm2 > 0) ++with_deformable_tissue_;
      if (state_.device[0].proxy.relaxation.is_active()) ++relaxed_;
      if (!state_.holes.empty()) ++with_holes_;
      if ((record_.device[0].flags & kFlagNoGo) != 0) ++no_go_ticks_;
      if (record_.device[0].near_label.back() != 0) ++near_many_;
    }
  }
  /// Ticks in which deformable tissue was pressed.
  int with_deformable_tissue() const { return with_deformable_tissue_; }
  /// Ticks in which such tissue has relaxation state.
  int relaxed() const { return relaxed_; }
  /// Number of changes of the law under a tool.
  int law_changes() const { return law_changes_; }
  /// Ticks with a puncture that stayed open.
  int with_holes() const { return with_holes_; }
  /// Ticks in which a no-go region exerted force, and in which the maximum number of near structures was
  /// reported.
  int no_go_ticks() const { return no_go_ticks_; }
  int near_many() const { return near_many_; }

 private:
  int with_deformable_tissue_ = 0, relaxed_ = 0, with_holes_ = 0, law_changes_ = 0, no_go_ticks_ = 0,
      near_many_ = 0;
  Model model_ = crowded_model();
  /// Data that the model does not contain at present.
  DistanceTrees distances_ = std::move(model_.distance_trees);
  std::vector<NoGoRegion> no_go_ = std::move(model_.no_go);
  Parameters parameters_;
  SessionState state_;
  TickRecord record_;
  std::array<DeviceState, 2> devices_;
  std::array<Wrench, 2> wrenches_;
};

// a burr that is moved through bone next to another device's probe, with versions carved from it by others
class BurrExercise {
 public:
  explicit BurrExercise(bool cone = false) {
    Model model = testing::with_exact_surfaces(testing::ball_model({1, 1, 1}));
    model.tools[0].radius_mm = 2;
    model.tools[0].burr = BurrSettings{};
    if (cone) {
      model.tools[0].burr->length_mm = 5;
      model.tools[0].burr->end_radius_mm = 2.6;
    }
    Tool& probe = model.tools.emplace_back();
    probe.points_mm = {{0, 0, 0}, {3, 0, 0}};
    probe.capsules = {{{0, 0, 0}, {0, 0, 40}, 1.5}};
    parameters_.method = ForceMethod::kProxy;
    parameters_.motor = true;
    state_.device[0].output.gain = state_.device[1].output.gain = 1;
    models_.push_back(std::make_shared<const Model>(model));
    auto carving = std::make_shared<const Carving>(model);
    while (models_.size() < 20) {
      run(100);
      std::vector<Cut> cuts;
      const BurrState& burr = state_.device[0].burr;
      for (const Sweep& sweep : burr.pending().first(finished_sweeps(burr) - burr.first_sweep))
        cuts.push_back({0, sweep});
      carving = carving->with(cuts);
      models_.push_back(carving->applied_to(*models_.back()));
    }
    run(100);
    removed_mm3_ = state_.device[0].burr.removed_mm3;
    state_ = {};
    state_.device[0].output.gain = state_.device[1].output.gain = 1;
    ticks_ = 0;
    pressed_N_ = 0;
  }
  // repeats the same motion
  void run(int ticks) {
    for (int n = 0; n < ticks; ++n, ++ticks_) {
      const std::size_t version =
          std::min<std::size_t>(static_cast<std::size_t>(ticks_ / 100), models_.size() - 1);
      const double turn = 2e-3 * ticks_;
      devices_[0].tip = models_[0]->X_WorldPatient *
                        Point<Patient>(6 * std::sin(turn), 6 * std::cos(turn) - 6, 17.5 - 3e-3 * ticks_);
      devices_[1].tip =
          models_[0]->X_WorldPatient * Point<Patient>(3 * std::sin(turn), -15.5 - 1.5 * std::cos(turn), 2);
      tick(*models_[version], parameters_, devices_, 1e-3, state_, wrenches_, record_);
      pressed_N_ = std::max(pressed_N_, wrenches_[1].force_N.norm());
    }
  }
  double removed_mm3() const { return state_.device[0].burr.removed_mm3; }
  /// Largest force on the probe.
  double pressed_N() const { return pressed_N_; }
  /// Removed volume when its versions were made.
  double first_taken_mm3() const { return removed_mm3_; }

 private:
  std::vector<std::shared_ptr<const Model>> models_;
  Parameters parameters_;
  SessionState state_;
  TickRecord record_;
  std::array<DeviceState, 2> devices_;
  std::array<Wrench, 2> wrenches_;
  int ticks_ = 0;
  double pressed_N_ = 0;
  double removed_mm3_ = 0;
};

// runs `work` in a child that may make only these two system calls and exit; returns whether it survived
bool runs_with_system_calls(const std::function<void()>& work, unsigned first, unsigned second) {
  std::fflush(nullptr);
  const pid_t child = ::fork();
  if (child == 0) {
    const sock_filter program[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, first, 2, 0),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, second, 1, 0),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_exit_group, 0, 1),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS),
    };
    const sock_fprog filter{std::size(program), const_cast<sock_filter*>(program)};
    if (::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 ||
        ::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &filter) != 0)
      ::_exit(3);
    work();
    // instead of _exit, in which a sanitizer would first look for leaks
    ::syscall(SYS_exit_group, 0);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  EXPECT_FALSE(WIFEXITED(status) && WEXITSTATUS(status) == 3) << "this kernel has no seccomp filters";
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

bool runs_without_system_calls(const std::function<void()>& work) {
  return runs_with_system_calls(work, SYS_exit_group, SYS_exit_group);
}

// the production loop with the simulated device, in this thread and for a number of ticks: parameters,
// models, intentions and an emergency stop are posted, and the ring overflows
class LoopExercise : private ServoClock {
 public:
  LoopExercise() { driver_.intend(Point<Device>(14, 0, 0), monotonic_ns() + 500'000'000); }
  void leave_news() {
    loop_.change([](Parameters& parameters) {
      parameters.friction = !parameters.friction;
      parameters.rotation_target =
          Eigen::AngleAxisd(parameters.friction ? 0.1 : 0.0, Eigen::Vector3d::UnitZ());
    });
    EXPECT_TRUE(loop_.set_model(model(++version_)).ok());
    loop_.reset_health();
  }
  void run(int ticks) {
    left_ = ticks;
    driver_.run(loop_, *this);
  }
  std::uint64_t ticks() const { return loop_.health().ticks; }
  std::uint64_t dropped() const { return loop_.health().dropped; }

 private:
  bool wait() noexcept override {
    // a stop, out of the ball, rearmed and back
    const bool out = left_ % 500 >= 300;
    if (left_ % 50 == 0)
      driver_.intend(Point<Device>(out ? 40 : left_ % 100 ? 12 : 17, 0, 0), monotonic_ns() + 5'000'000);
    if (left_ % 500 == 499) loop_.emergency_stop();
    std::uint32_t number = 0;
    if (left_ % 500 == 300) (void)loop_.rearm(loop_.arming().number, number);
    return left_-- > 0 && loop_.wait();
  }
  bool stopped() const noexcept override { return left_ <= 0; }

  static SimulatedDevice device() {
    SimulatedDevice device(known_plant_devices()[0], known_plant_hands()[1], 1e-3);
    device.reset(Point<Device>(25, 0, 0));
    return device;
  }
  SimulatedDriver driver_{device()};
  static std::shared_ptr<const Model> model(std::uint32_t version) {
    Model made = testing::ball_model({1, 1, 1}, 1.0, 3);
    made.version = version;
    return std::make_shared<const Model>(std::move(made));
  }
  std::uint32_t version_ = 1;
  Loop loop_{
      model(1), driver_, {}, {WorkspaceSettings{}}, {.rate_hz = 10000, .spin_s = 20e-6, .ring_s = 0.5}};
  int left_ = 0;
};

TEST(Realtime, CountersDetectForbiddenCalls) {
  // otherwise the tests below could pass because nothing is detected
  const long allocated = allocations;
  auto number = std::make_unique<int>(3);
  EXPECT_EQ(allocations - allocated, 1);
  Eigen::VectorXd vector = Eigen::VectorXd::Zero(*number * 100);
  EXPECT_EQ(allocations - allocated, 2) << "Eigen's own allocation";
  EXPECT_EQ(vector.sum(), 0);
  const long freed = frees;
  number.reset();
  EXPECT_EQ(frees - freed, 1);
#if !defined(__SANITIZE_THREAD__)
  const long locked = locks;
  std::mutex mutex;
  mutex.lock();
  mutex.unlock();
  EXPECT_EQ(locks - locked, 1);
#endif

  EXPECT_TRUE(runs_without_system_calls([] {}));
  EXPECT_FALSE(runs_without_system_calls([] { std::fprintf(stderr, "logged\n"); }));
  EXPECT_FALSE(runs_without_system_calls([] { std::cerr << "logged" << std::endl; }));
  EXPECT_FALSE(runs_without_system_calls([] { ::usleep(1); }));
#if !defined(__SANITIZE_THREAD__)
  // ThreadSanitizer's sleep makes other system calls
  EXPECT_TRUE(runs_with_system_calls([] { ::usleep(1); }, SYS_clock_nanosleep, SYS_clock_gettime));
#endif
  EXPECT_FALSE(runs_with_system_calls([] { ::getppid(); }, SYS_clock_nanosleep, SYS_clock_gettime));
}

TEST(Realtime, TenThousandTicksMakeNoAllocationOrLock) {
  Exercise exercise;
  exercise.run(100);
  const long allocated = allocations + frees, locked = locks;
  exercise.run(10000);
  const long allocated_after = allocations + frees, locked_after = locks;
  EXPECT_EQ(allocated_after - allocated, 0);
  EXPECT_EQ(locked_after - locked, 0);
  EXPECT_GT(exercise.with_deformable_tissue(), 40);
  EXPECT_GT(exercise.law_changes(), 3);
  EXPECT_GT(exercise.relaxed(), 100);
  EXPECT_GT(exercise.with_holes(), 100);
  EXPECT_GT(exercise.no_go_ticks(), 200);
  EXPECT_GT(exercise.near_many(), 20);
}

TEST(Realtime, BurrTicksMakeNoAllocationLockOrSystemCall) {
  for (const bool cone : {false, true}) {
    SCOPED_TRACE(cone);
    BurrExercise exercise(cone);
    const long allocated = allocations + frees, locked = locks;
    exercise.run(2000);
    const long allocated_after = allocations + frees, locked_after = locks;
    EXPECT_EQ(allocated_after - allocated, 0);
    EXPECT_EQ(locked_after - locked, 0);
    EXPECT_EQ(exercise.removed_mm3(), exercise.first_taken_mm3());
    EXPECT_GT(exercise.removed_mm3(), 2);
    EXPECT_GT(exercise.pressed_N(), 0.5);
    BurrExercise again(cone);
    EXPECT_TRUE(runs_without_system_calls([&] { again.run(2000); }));
  }
}

TEST(Realtime, TenThousandTicksMakeNoSystemCall) {
  Exercise exercise;
  exercise.run(100);
  EXPECT_TRUE(runs_without_system_calls([&] { exercise.run(10000); }));
}

TEST(Realtime, TenThousandLoopTicksMakeNoAllocationOrLock) {
  LoopExercise exercise;
  exercise.run(100);
  long allocated = 0, locked = 0;
  for (int stretch = 0; stretch < 4; ++stretch) {
    exercise.leave_news();
    const long allocated_before = allocations + frees, locked_before = locks;
    exercise.run(2500);
    allocated += allocations + frees - allocated_before;
    locked += locks - locked_before;
  }
  EXPECT_EQ(allocated, 0);
  EXPECT_EQ(locked, 0);
  EXPECT_EQ(exercise.ticks(), 2500u) << "since the last reset";
  EXPECT_EQ(exercise.dropped(), 10100u - 8192) << "the ring of half a second was full";
}

TEST(Realtime, TenThousandLoopTicksOnlyReadTheClockAndSleep) {
  LoopExercise exercise;
  exercise.run(100);
  exercise.leave_news();
  EXPECT_TRUE(runs_with_system_calls([&] { exercise.run(10000); }, SYS_clock_nanosleep, SYS_clock_gettime));
}

}  // namespace
}  // namespace palpate
