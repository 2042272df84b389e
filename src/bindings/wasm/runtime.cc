// Run time of libc++ and of the C++ ABI for threads and exceptions, where there are neither
// (cmake/wasm/libcxx/__external_threading).

#include <cstdio>
#include <cstdlib>
#include <exception>
#include <mutex>
#include <thread>
#include <typeinfo>

extern "C" {

void* __cxa_allocate_exception(std::size_t size) noexcept {
  return std::malloc(size);
}

/// An exception ends the program: there are no handlers. The page shows the last line on stderr.
[[noreturn]] void __cxa_throw(void* thrown, std::type_info* type, void (*)(void*)) {
  const bool is_memory = *type == typeid(std::bad_alloc) || *type == typeid(std::bad_array_new_length);
  std::fprintf(stderr, "%s\n", is_memory ? "out of memory" : type->name());
  (void)thrown;
  __builtin_trap();
}

}  // extern "C"

_LIBCPP_BEGIN_NAMESPACE_STD

mutex::~mutex() noexcept = default;
void mutex::lock() {
  __libcpp_mutex_lock(&__m_);
}
bool mutex::try_lock() noexcept {
  return __libcpp_mutex_trylock(&__m_);
}
void mutex::unlock() noexcept {
  __libcpp_mutex_unlock(&__m_);
}

condition_variable::~condition_variable() = default;
void condition_variable::notify_one() noexcept {}
void condition_variable::notify_all() noexcept {}
void condition_variable::wait(unique_lock<mutex>& lock) noexcept {
  __libcpp_condvar_wait(&__cv_, lock.mutex()->native_handle());
}

// no thread is ever created
__thread_struct::__thread_struct() : __p_(nullptr) {}
__thread_struct::~__thread_struct() = default;
thread::~thread() = default;
void thread::join() {
  __builtin_trap();
}
namespace this_thread {
void sleep_for(const chrono::nanoseconds& /*time*/) {
  __builtin_trap();
}
}  // namespace this_thread
unsigned thread::hardware_concurrency() noexcept {
  return 1;
}

_LIBCPP_END_NAMESPACE_STD
