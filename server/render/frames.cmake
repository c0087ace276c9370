# The sources of candela_frames, for this build and for tests/bits/cross.
set(candela_host_kernels
    host/bloom.cc host/ingest.cc host/resize.cc host/resolve.cc host/view.cc)
set(candela_frames_sources
    ${candela_host_kernels}
    color/aces2.cc color/hdr_signal.cc environment/environment.cc environment/view.cc
    environment/view_tiles.cc frame/executor.cc frame/frame_memory.cc frame/table_points.cc
    frame/texture_pool.cc frame/tile_sums.cc host/host_executor.cc plan/exposure.cc plan/frame_stats.cc
    plan/lit_area.cc plan/plan.cc plan/resize_plan.cc plan/texture_layout.cc settings/error_bound.cc
    settings/gain_curve_of.cc settings/hdr_display.cc settings/settings.cc settings/tiers.cc)

# Kernels, whose calls have to be inlined in a debug build, too, and what runs them. Highway's NEON comes with AES, and what the
# compiler writes by itself, such as constructors, has to be for the same target.
set(candela_host_kernel_options $<$<CONFIG:Debug>:-O2>)
if(CMAKE_SYSTEM_PROCESSOR MATCHES "^(aarch64|arm64)$")
  list(APPEND candela_host_kernel_options -march=armv8-a+crypto)
endif()
