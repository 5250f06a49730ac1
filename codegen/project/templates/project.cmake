# cmake -B build -DCMAKE_C_COMPILER=@{ board.prefix ~ "gcc -DCMAKE_TRY_COMPILE_TARGET_TYPE=STATIC_LIBRARY -DCMAKE_SYSTEM_NAME=Generic" if board.bare else "gcc" } && cmake --build build && (cd build && ctest)
# In a project of yours: add_subdirectory(this folder) and target_link_libraries(yours @{ robot }). The library is then compiled with
# the flags of your project, and adds nothing to them but the path to its headers.
cmake_minimum_required(VERSION 3.13)
project(@{ robot } C)
file(GLOB NOSLIP CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/noslip/*.c)
add_library(@{ robot } STATIC ${NOSLIP})
target_include_directories(@{ robot } PUBLIC noslip)
target_compile_options(@{ robot } PRIVATE @{ flags | join(" ") })
set_target_properties(@{ robot } PROPERTIES C_STANDARD 99 C_EXTENSIONS OFF)

if(CMAKE_SOURCE_DIR STREQUAL CMAKE_CURRENT_SOURCE_DIR)
    if(NOT CMAKE_BUILD_TYPE)
        set(CMAKE_BUILD_TYPE Release)
    endif()
    set(CMAKE_C_FLAGS_RELEASE "-O2")
    add_executable(selftest @{ (["selftest/selftest.c"] + board.sources) | join(" ") })
    target_include_directories(selftest PRIVATE board selftest)
    target_link_libraries(selftest PRIVATE @{ robot })
    set_target_properties(selftest PROPERTIES C_STANDARD 99 C_EXTENSIONS OFF)
{% if board.own_flags %}
    target_compile_options(@{ robot } PRIVATE @{ board.own_flags })
    target_compile_options(selftest PRIVATE @{ ([board.own_flags] + board.define | list) | join(" ") })
{% endif %}
{% if board.bare %}
    target_link_options(selftest PRIVATE @{ ((board.flags | list) + (board.link | list)) | join(" ") | replace("board/", "${CMAKE_CURRENT_SOURCE_DIR}/board/") })
{% endif %}
    enable_testing()
    add_test(NAME selftest COMMAND @{ ((board.run | list) + ["$<TARGET_FILE:selftest>"]) | join(" ") if board.run else "selftest" })
    set_tests_properties(selftest PROPERTIES TIMEOUT 60)
endif()
