# WebAssembly by Debian's clang 19, libc++ 19 and wasi-libc (docs/decisions/0087-webassembly.md): one thread, SIMD of 128
# bits, and no exceptions, so that `throw` ends the program (src/bindings/wasm/runtime.cc).
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR wasm32)
set(PALPATE_WASM ON)

set(CMAKE_C_COMPILER clang-19)
set(CMAKE_CXX_COMPILER clang++-19)
set(CMAKE_C_COMPILER_TARGET wasm32-wasi)
set(CMAKE_CXX_COMPILER_TARGET wasm32-wasi)
# modules are object libraries: no archiver is needed
set(CMAKE_AR ar)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)

# `try` and `catch` are compiled, without tables of handlers: wasm-ld finds __cxa_throw in runtime.cc
set(CMAKE_CXX_FLAGS_INIT "-msimd128 -fexceptions -fexperimental-library -isystem ${CMAKE_CURRENT_LIST_DIR}/libcxx -D_WASI_EMULATED_SIGNAL -D_WASI_EMULATED_MMAN -DHWY_COMPILE_ONLY_EMU128")
set(CMAKE_C_FLAGS_INIT "-msimd128")
