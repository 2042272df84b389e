# writes OUTPUT only when its content changes, so that nothing is rebuilt for nothing
execute_process(COMMAND git -C ${SOURCE_DIR} rev-parse --short=12 HEAD
                OUTPUT_VARIABLE commit OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET RESULT_VARIABLE failed)
if(failed)
  set(commit "unknown")
else()
  execute_process(COMMAND git -C ${SOURCE_DIR} status --porcelain --untracked-files=no
                  OUTPUT_VARIABLE changes OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
  if(changes)
    string(APPEND commit "+changes")
  endif()
endif()
set(content "#pragma once
#define PALPATE_VERSION \"${VERSION}\"
#define PALPATE_COMMIT \"${commit}\"
#define PALPATE_BUILD_TYPE \"${BUILD_TYPE}\"
#define PALPATE_COMPILER \"${COMPILER}\"
#define PALPATE_SANITIZERS \"${SANITIZE}\"
")
set(previous "")
if(EXISTS ${OUTPUT})
  file(READ ${OUTPUT} previous)
endif()
if(NOT content STREQUAL previous)
  file(WRITE ${OUTPUT} "${content}")
endif()
