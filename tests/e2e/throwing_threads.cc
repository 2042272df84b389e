// LD_PRELOAD library that makes a chosen thread throw: before and after each intercepted blocking call a
// thread compares its number with the one in the file THROWING_THREAD (four bytes; 0: none).
#include <dlfcn.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <sys/epoll.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <stdexcept>

namespace {

const std::atomic<pid_t>* chosen() {
  static const auto* const number = []() -> const std::atomic<pid_t>* {
    const char* const name = std::getenv("THROWING_THREAD");
    const int file = name != nullptr ? ::open(name, O_RDONLY | O_CLOEXEC) : -1;
    if (file < 0) return nullptr;
    void* const mapping = ::mmap(nullptr, sizeof(std::atomic<pid_t>), PROT_READ, MAP_SHARED, file, 0);
    ::close(file);
    return mapping == MAP_FAILED ? nullptr : static_cast<const std::atomic<pid_t>*>(mapping);
  }();
  return number;
}
// before another of the process's threads can be the first
[[maybe_unused]] const auto* const kChosen = chosen();

void throw_if_chosen() {
  const auto* const number = chosen();
  if (number != nullptr && *number != 0 && *number == ::gettid())
    throw std::runtime_error("thrown for a test");
}

template <class Function>
Function* real(const char* name) {
  return reinterpret_cast<Function*>(::dlsym(RTLD_NEXT, name));
}

template <class Function, class... Arguments>
auto throwing_if_chosen(Function* function, Arguments... arguments) {
  throw_if_chosen();
  const auto result = function(arguments...);
  throw_if_chosen();
  return result;
}

}  // namespace

// blocking calls used by threads; none of them is declared noexcept
#define PALPATE_INTERPOSE(name, parameters, arguments)         \
  extern "C" int name parameters {                             \
    static auto* const function = real<int parameters>(#name); \
    return throwing_if_chosen arguments;                       \
  }
PALPATE_INTERPOSE(nanosleep, (const timespec* requested, timespec* left), (function, requested, left))
PALPATE_INTERPOSE(clock_nanosleep, (clockid_t clock, int flags, const timespec* requested, timespec* left),
                  (function, clock, flags, requested, left))
PALPATE_INTERPOSE(poll, (pollfd * files, nfds_t count, int timeout_ms), (function, files, count, timeout_ms))
PALPATE_INTERPOSE(ppoll, (pollfd * files, nfds_t count, const timespec* timeout, const sigset_t* mask),
                  (function, files, count, timeout, mask))
PALPATE_INTERPOSE(pthread_cond_wait, (pthread_cond_t * condition, pthread_mutex_t* mutex),
                  (function, condition, mutex))
PALPATE_INTERPOSE(pthread_cond_timedwait,
                  (pthread_cond_t * condition, pthread_mutex_t* mutex, const timespec* until),
                  (function, condition, mutex, until))
PALPATE_INTERPOSE(pthread_cond_clockwait,
                  (pthread_cond_t * condition, pthread_mutex_t* mutex, clockid_t clock,
                   const timespec* until),
                  (function, condition, mutex, clock, until))
#undef PALPATE_INTERPOSE

// not as it returns: what it tells is told once
extern "C" int epoll_wait(int file, epoll_event* events, int largest, int timeout_ms) {
  static auto* const function = real<int(int, epoll_event*, int, int)>("epoll_wait");
  throw_if_chosen();
  return function(file, events, largest, timeout_ms);
}
