"""The formalism, one file per route, generic over the scalar. The table of symbols, and the code names that stand for them:

| symbol | meaning | here |
|---|---|---|
| β, η | joint coordinates, joint velocities | `q`, `v`; `beta`, `eta` of one joint |
| H(β), φ(β) | β̇ = H η (5), side condition (6) | `JointType.rate`, `JointType.side_condition` |
| v̌, ǎ | twist (ω, v), acceleration (ε, a) of a body | `twist`, `a` |
| M_i: m, mρ, Θ | inertia about O, (7) | `RigidInertia`: `mass`, `moment`, `tensor` |
| f̌ᶜ | gyroscopic wrench | `newton_euler.gyroscopic` |
| f̌ᵗ | applied wrenches; joint forces u, coordinate forces τ | `wrenches`; `u`, `tau` |
| f̌ᵏ | resultant constraint wrench on a body | `newton_euler.resultants` |
| f̌ᵖ = B⁻ᵀ f̌ᵏ | constraint wrench of a joint (8) | `reactions` |
| B, C, ā_rel, J | joint constraints (10), (11), (13) | `constraints` |
| (18), (19) | saddle-point systems | `saddle` |
| M̂, k̂ | minimal form | `nonrecursive.mass_matrix`, `bias_forces` |
"""
