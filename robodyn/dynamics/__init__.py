"""Robot, gravity and loads put into the formalism, and what can be asked of them. Generic over the scalar; free of the engine.

equations   everything that is known of a robot with what acts on it, at a state
views       those equations on the trees that a question needs: links lumped, or cut open at joints
state_vector   the state of a scene as one vector x = (β, η, z, w)
questions   what can be asked, one class per question
"""
