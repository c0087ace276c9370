# The sources of host_bits, for this build and for tests/bits/cross.
set(host_bits_sources ../../server/session/exposure_track.cc ../support/scenes.cc exposure_cases.cc
                      frame_cases.cc host_bits.cc render_frame.cc tables.cc view_cases.cc)
