// GLSL's keywords as the types of lanes-inl.h, for the shared files that follow. glsl-end.h ends it.
#define float F
#define int I
#define uint U
#define bool B
#define precise
