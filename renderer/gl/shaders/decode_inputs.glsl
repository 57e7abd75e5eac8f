// What every decoder reads (processing/codecs/shader_form.h).

layout(binding = 0) uniform sampler2DArray btf_layers;
layout(binding = 4) uniform samplerBuffer btf_table;
layout(location = 17) uniform int btf_columns;
layout(location = 18) uniform float btf_scale;
