"""The formalism, one file per route, generic over the scalar. The table of symbols, and the code names that stand for them:

| symbol | meaning | here |
|---|---|---|
| β, η | joint coordinates, joint velocities | `q`, `v`; `beta`, `eta` of one joint |
| H(β), φ(β) | β̇ = H η (5), side condition (6) | `JointType.rate`, `JointType.side_condition` |
| t, β, η, z | one state, its kinematics found once | `State`; `Motion`: poses, `subspace` S, `twist`, `bias` |
| v̌, ǎ | twist (ω, v), acceleration (ε, a) of a body at O_i, in K_i | `twist`, `a` |
| M_i: m, mρ, Θ | inertia about O, (7) | `RigidInertia`: `mass`, `moment`, `tensor` |
| f̌ᶜ | gyroscopic wrench | `newton_euler.gyroscopic` |
| f̌ᵗ | applied wrenches; joint forces u, coordinate forces τ | `wrenches`; `u`, `tau` |
| f̌ᵏ | resultant constraint wrench on a body; at η̇ = 0 | `newton_euler.resultants`; `resting` |
| f̌ᵖ = B⁻ᵀ f̌ᵏ | constraint wrench of a joint (8) | `reactions` |
| B, C, v̄_rel, ā_rel, J | joint constraints (10), (11), (13) | `constraints`; `JointType.motion`, `drift`, `bias` |
| (18), (19) | saddle-point systems | `saddle` |
| M̂, k̂ | minimal form | `nonrecursive.mass_matrix`, `bias_forces` |

Every wrench is about O_i and resolved in K_i, unless its docstring says otherwise. `wrenches` are those of loads, on bodies, `resultants`
and `resting` are on bodies from their joints together, `joint_wrenches` and `total` on a child from its parent.
"""
