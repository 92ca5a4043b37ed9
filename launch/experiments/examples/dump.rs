#![allow(missing_docs, clippy::all, clippy::unwrap_used)]
use evac_experiments::*;
use evac_geometry::{map_from_lidar,log_so3};
fn main(){
    let name=std::env::args().nth(1).unwrap();
    let fault=std::env::args().nth(2).unwrap_or("none".into());
    let every:usize=std::env::args().nth(3).and_then(|v|v.parse().ok()).unwrap_or(10);
    let mut settings=Settings::default();
    for a in std::env::args().skip(4){settings.set(&a).unwrap();}
    let data=std::path::Path::new("../shared/data");
    let mut sources=recorded(data); sources.extend(catalogue());
    let walk=sources.into_iter().find(|s|s.name==name).unwrap().load(None).unwrap();
    let f=Fault::ALL.iter().copied().find(|f|f.name()==fault).unwrap();
    let walk=f.applied(&walk,1);
    let t=run(&walk,&settings);
    let mut rebase=None;
    for (i,fr) in t.frames.iter().enumerate(){
        let e=map_from_lidar(&fr.pose);
        let r=*rebase.get_or_insert(fr.truth*e.inverse());
        let est=r*e;
        let d=est.translation.vector-fr.truth.translation.vector;
        let local=fr.truth.rotation.inverse()*d;
        let rot=log_so3(&(fr.truth.rotation.inverse()*est.rotation))*57.2958;
        let p=fr.truth.translation.vector;
        if i%every==0 { println!("{i:4} st{} deg{} q{:.2} p[{:6.2} {:6.2} {:5.2}] err xyz[{:7.3} {:7.3} {:7.3}] fwd/left/up[{:7.3} {:7.3} {:7.3}] rot[{:6.3} {:6.3} {:6.3}] sig[{:.3} {:.3} {:.3}] v{:.2} bg[{:.4} {:.4} {:.4}] ba[{:.3} {:.3} {:.3}] td{:.2}",fr.pose.state,fr.pose.degenerate,fr.pose.quality,p.x,p.y,p.z,d.x,d.y,d.z,local.x,local.y,local.z,rot.x,rot.y,rot.z,fr.pose.covariance[0].sqrt(),fr.pose.covariance[7].sqrt(),fr.pose.covariance[14].sqrt(),evac_geometry::nalgebra::Vector3::from(fr.pose.velocity).norm(),fr.pose.gyro_bias[0],fr.pose.gyro_bias[1],fr.pose.gyro_bias[2],fr.pose.accel_bias[0],fr.pose.accel_bias[1],fr.pose.accel_bias[2],fr.pose.time_offset_ns as f64*1e-6);}
    }
    println!("{}",t.diagnostics);
}
